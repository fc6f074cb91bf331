"""Fast CPU forms of what `learning` computes; each equals its plain form."""
