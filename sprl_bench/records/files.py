"""JSON files: checked against a type when read, written whole or not at all.

Nothing is evaluated and nothing is unpickled. An invalid file is refused with one sentence that names the file, the
line in it, and the key.
"""

from __future__ import annotations

import codecs
import os
import re
import secrets
import stat
from collections.abc import Callable, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from sprl_bench.records.places import Place, find_duplicate, find_line
from sprl_bench.suggestions import did_you_mean

SHOWN_LETTERS = 80
MARKS: Final = MappingProxyType(
    {
        codecs.BOM_UTF8: "UTF-8",
        codecs.BOM_UTF32_LE: "UTF-32",  # begins with the next one
        codecs.BOM_UTF16_LE: "UTF-16",
        codecs.BOM_UTF32_BE: "UTF-32",
        codecs.BOM_UTF16_BE: "UTF-16",
    }
)
LARGEST: Final = 2**26  # bytes of a file that is read; a record has about 10,000
OURS = "Value error, "  # pydantic puts this before our own sentences


class Data(BaseModel):
    """Immutable, strict about names and types, finite numbers only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)


class InvalidFileError(ValueError):
    """An invalid file; the message names the file, the line and the first wrong key."""


Model = TypeVar("Model", bound=Data)
OnBroken = Callable[[Path, Exception], None]
"""Receives the folder of a run that cannot be read, and the error."""


def refuse(_folder: Path, error: Exception) -> None:
    """Raise the error: one run that cannot be read stops the reading of all."""
    raise error


def read(path: Path, model: type[Model]) -> Model:
    """Read and check one JSON file.

    Raises:
        InvalidFileError: It is truncated, has an unknown, missing or repeated key, a wrong type, or a number that is
            not finite.
        FileNotFoundError: There is no such file.
    """
    content = read_bytes(path)
    refuse_mark(path, content)
    try:
        data = model.model_validate_json(content)
    except ValidationError as error:
        raise InvalidFileError(f"{path}:{_describe(content, error)}") from None
    text = content.decode()
    if duplicate := find_duplicate(text):
        raise InvalidFileError(f"{path}:{find_line(text, duplicate)}: {_name(duplicate)}: this key is given twice")
    return data


def refuse_mark(path: Path, content: bytes) -> None:
    """Refuse a file that begins with a byte-order mark, as some editors write it unasked.

    Raises:
        InvalidFileError: It does.
    """
    for mark, encoding in MARKS.items():
        if content.startswith(mark):
            raise InvalidFileError(
                f"{path}:1: the file begins with a byte-order mark ({encoding}); it must be UTF-8 without one"
            )


def read_bytes(path: Path) -> bytes:
    """Return the content of a regular file of at most `LARGEST` bytes.

    Raises:
        InvalidFileError: It is something else, such as a pipe, or larger.
        FileNotFoundError: There is no such file.
    """
    size = require_regular(path)
    if size > LARGEST:
        raise InvalidFileError(f"{path} has {size:,} bytes; it must have at most {LARGEST:,}.")
    return path.read_bytes()


def require_regular(path: Path) -> int:
    """Return the size of a regular file in bytes; reading a pipe or a device might never end.

    Raises:
        InvalidFileError: It is something else.
        FileNotFoundError: There is no such file.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise InvalidFileError(f"{path} is not a regular file; it must be one.")
    return status.st_size


def locate(path: Path, place: Place) -> int:
    """Return the line of a valid JSON file on which the value at `place` begins; see `find_line`."""
    return find_line(path.read_text(encoding="utf-8"), place)


def _describe(content: bytes, error: ValidationError) -> str:
    """Return "LINE: PLACE: ERROR" for the first error."""
    first = _sorted(error)[0]
    if first["type"] == "json_invalid":
        line = re.search(r"at line (\d+)", first["msg"])
        return f"{line.group(1) if line else 1}: {printable(first['msg'], 200)}"
    return f"{find_line(content.decode(), first['loc'] + _subject(first))}: {first_complaint(error)}"


def first_complaint(error: ValidationError) -> str:
    """Return "PLACE: ERROR" for the first error."""
    errors = _sorted(error)
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return f"{_name(errors[0]['loc'])}: {_complaint(errors[0], errors)}{more}"


def _sorted(error: ValidationError) -> list[ErrorDetails]:
    """Return all errors, unknown keys first: an unknown key is often a missing one, misspelt."""
    return sorted(error.errors(include_url=False), key=lambda one: one["type"] != "extra_forbidden")


def _subject(error: ErrorDetails) -> Place:
    """Return the place that begins a sentence of ours, as in "scores.auc is..."."""
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
            return printable(first["msg"].removeprefix(OURS), 400)
    return f"{printable(first['msg'], 200)}, not {printable(repr(first['input']), SHOWN_LETTERS)}"


def _name(place: Place) -> str:
    return printable(".".join(str(part) for part in place), SHOWN_LETTERS) or "the file"


def printable(text: str, letters: int) -> str:
    """Return `text` on one line of at most `letters`, without control characters."""
    line = "".join(letter if letter.isprintable() else "?" for letter in " ".join(text.split()))
    return line if len(line) <= letters else f"{line[:letters]}..."


def write(path: Path, data: Data, *, own: bool = False) -> None:
    """Write one JSON file, whole or not at all; `own` as for `write_bytes`."""
    write_bytes(path, (data.model_dump_json(indent=1) + "\n").encode(), own=own)


STREAMS: Final = (Path("/dev"), Path("/dev/fd"))  # not /dev/shm, which may hold folders of runs


def write_bytes(path: Path, content: bytes, *, own: bool = False) -> None:
    """Write a temporary file beside `path`, flush it to the disk, and rename it.

    A link is followed; a device or a pipe, such as /dev/stdout, is written to instead of replaced.

    Args:
        path: The file.
        content: All of it.
        own: Whether the file belongs to a run's folder: then whatever has its name, a link too, is replaced.

    Raises:
        OSError: It cannot be written; the error names `path`.
    """
    try:
        _write(path, content, own=own)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error  # of the subclass that its number has


def _write(path: Path, content: bytes, *, own: bool) -> None:
    if own:
        _replace(path.absolute(), content)
    elif path.parent in STREAMS or (path.exists() and not path.is_file()):
        with path.open("ab") as stream:  # appends, if standard output is redirected to a file
            stream.write(content)
    else:
        _replace(path.resolve(), content)


def _replace(path: Path, content: bytes) -> None:
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
