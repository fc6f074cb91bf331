"""JSON files: read with suspicion, written whole or not at all.

Nothing is evaluated and nothing is unpickled. What a file must hold is said by its type; a file that holds anything
else is refused with one line that names the file, the line in it, and the place.
"""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from sprl_bench.records.places import Place, find_duplicate, find_line
from sprl_bench.suggestions import did_you_mean

SHOWN_LETTERS = 80
OURS = "Value error, "
"""What pydantic puts before a sentence of ours."""


class Data(BaseModel):
    """Immutable, strict about names and types, finite numbers only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class InvalidFileError(ValueError):
    """A file that does not hold what it should; the message names the file, the line and the first place."""


Model = TypeVar("Model", bound=Data)


def read(path: Path, model: type[Model]) -> Model:
    """Read and check one JSON file.

    Raises:
        InvalidFileError: It is truncated, has an unknown, missing or repeated key, a wrong type, or a number that is
            not finite.
        FileNotFoundError: There is no such file.
    """
    content = path.read_bytes()
    try:
        data = model.model_validate_json(content)
    except ValidationError as error:
        raise InvalidFileError(f"{path}:{_describe(content, error)}") from None
    text = content.decode()
    if duplicate := find_duplicate(text):
        raise InvalidFileError(f"{path}:{find_line(text, duplicate)}: {_name(duplicate)}: this key is there twice")
    return data


def locate(path: Path, place: Place) -> int:
    """Return the line of a valid JSON file on which the value at `place`, or the innermost around it, begins."""
    return find_line(path.read_text(encoding="utf-8"), place)


def _describe(content: bytes, error: ValidationError) -> str:
    """Return "LINE: PLACE: what is wrong there", for the first thing that is wrong."""
    first = _sorted(error)[0]
    if first["type"] == "json_invalid":
        line = re.search(r"at line (\d+)", first["msg"])
        return f"{line.group(1) if line else 1}: {_printable(first['msg'], 200)}"
    return f"{find_line(content.decode(), first['loc'] + _subject(first))}: {first_complaint(error)}"


def first_complaint(error: ValidationError) -> str:
    """Return "PLACE: what is wrong there", for the first thing that is wrong."""
    errors = _sorted(error)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return f"{_name(errors[0]['loc'])}: {_complaint(errors[0], errors)}{more}"


def _sorted(error: ValidationError) -> list[ErrorDetails]:
    """Return what is wrong, unknown keys first: they are often what is missing elsewhere, misspelt."""
    return sorted(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")


def _subject(error: ErrorDetails) -> Place:
    """Return the place within the checked value that a sentence of ours begins with, as in "scores.auc is..."."""
    if error["type"] != "value_error":
        return ()
    words = re.findall(r"\w+", error["msg"].removeprefix(OURS).partition(" ")[0])
    return tuple(int(word) if word.isdecimal() else word for word in words)


def _complaint(first: ErrorDetails, errors: Sequence[ErrorDetails]) -> str:
    match first["type"]:
        case "extra_forbidden":
            missing = [str(other["loc"][-1]) for other in errors if other["type"] == "missing"]
            hint = did_you_mean(first["loc"][-1], missing)
            return f"this key is unknown; {hint}" if hint else "this key is unknown"
        case "missing":
            return "this key is missing"
        case "value_error":
            return _printable(first["msg"].removeprefix(OURS), 400)
    return f"{_printable(first['msg'], 200)}, not {_printable(repr(first['input']), SHOWN_LETTERS)}"


def _name(place: Place) -> str:
    return _printable(".".join(str(part) for part in place), SHOWN_LETTERS) or "the file"


def _printable(text: str, letters: int) -> str:
    """Return `text` on one line, without control characters, and not longer than `letters`."""
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
    return line if len(line) <= letters else f"{line[:letters]}..."


def write(path: Path, data: Data) -> None:
    """Write one JSON file so that `path` holds either what it held before or all of `data`."""
    write_bytes(path, (data.model_dump_json(indent=1) + "\n").encode())


STREAMS: Final = (Path("/dev"), Path("/dev/fd"))  # not /dev/shm, where folders of runs may well be


def write_bytes(path: Path, content: bytes) -> None:
    """Write a temporary file beside `path`, flush it to the disk, and rename it.

    A link is followed, and a device or a pipe, such as /dev/stdout, written to: neither is replaced.
    """
    if path.parent in STREAMS or (path.exists() and not path.is_file()):
        with path.open("ab") as stream:  # a file that standard output goes to keeps what it has
            stream.write(content)
        return
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with temporary.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
