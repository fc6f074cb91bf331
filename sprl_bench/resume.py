"""Which results and which checkpoint a run may continue from, and the sentences that say why not."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from sprl_bench import checkpoint, provenance
from sprl_bench.provenance import Provenance
from sprl_bench.records import RunRecord, RunSpec, differences, read
from sprl_bench.records.files import printable
from sprl_bench.records.folder import CHECKPOINT, RECORD, SPEC

logger = logging.getLogger("sprl_bench")

SHOWN_LETTERS: Final = 200  # of an error


class SpecChangedError(ValueError):
    """The folder holds a run of another spec under the same name."""


class CheckpointRefusedError(ValueError):
    """A whole checkpoint, but this process could not continue from it exactly."""


def find_finished(folder: Path, spec: RunSpec) -> RunRecord | None:
    """Return the complete record of `spec` in this folder, or None if there is none yet.

    Raises:
        SpecChangedError: There are results, but of another spec.
        InvalidFileError: A file in the folder is broken.
    """
    if (folder / RECORD).exists():
        record = read(folder / RECORD, RunRecord)
        _refuse_changes(folder, record.spec, spec)
        return record if record.status == "complete" else None
    if (folder / CHECKPOINT).exists() and (folder / SPEC).exists():
        _refuse_changes(folder, read(folder / SPEC, RunSpec), spec)
    return None


def _refuse_changes(folder: Path, on_disk: RunSpec, now: RunSpec) -> None:
    if changed := differences(on_disk, now):
        raise SpecChangedError(
            f"{folder} holds a run of another spec: {'; '.join(changed)}. Use another --out, or remove that folder."
        )


def load_checkpoint(path: Path, spec: RunSpec, here: Provenance) -> dict[str, Any] | None:
    """Return the state to continue from, or None to start from the beginning; the log says why.

    Args:
        path: The checkpoint, which need not exist.
        spec: The run that is to continue.
        here: The provenance of this process.

    Raises:
        CheckpointRefusedError: This process could not continue exactly.
    """
    try:
        state = checkpoint.load(path)
    except FileNotFoundError:
        return None
    except checkpoint.BrokenCheckpointError as error:
        logger.warning("%s The run starts over.", error)
        return None
    try:
        _refuse(path, state, spec, here)
    except (LookupError, TypeError, AttributeError, ValidationError) as error:
        raise other_build(path, error) from None
    return state


def other_build(path: Path, error: Exception) -> CheckpointRefusedError:
    """Return the refusal of a checkpoint whose state this build of the package cannot take."""
    cause = error.args[0] if isinstance(error, KeyError) and error.args else error  # its text would be in quotes
    text = printable(str(cause), SHOWN_LETTERS)
    return CheckpointRefusedError(
        f"{path} was made by another build of sprl-bench ({text}): continue with that one, or remove it to start over."
    )


def _refuse(path: Path, state: Mapping[str, Any], spec: RunSpec, here: Provenance) -> None:
    if changed := differences(RunSpec.model_validate_json(state["spec"]), spec):
        raise CheckpointRefusedError(f"{path} is of another run: {'; '.join(changed)}.")
    then = state["provenance"]
    if changed := _other_versions(then["versions"], here.versions):
        raise CheckpointRefusedError(
            f"{path} was made with {'; '.join(changed)}: install those versions, or remove it to start over."
        )
    if then["agent_code"] != here.agent_code:
        raise CheckpointRefusedError(
            f"{path} was made with other code of {spec.source}: restore that code, or remove it to start over."
        )
    if (cpu := then["hardware"]["cpu"]) != here.hardware.cpu:
        message = "%s was made on another CPU model (%s then, %s now): the last bits of later numbers may differ."
        logger.warning(message, path, cpu, here.hardware.cpu)


def _other_versions(then: Mapping[str, str], loaded: Mapping[str, str]) -> list[str]:
    """Return "PACKAGE VERSION then, VERSION now" for each that differs; some packages are loaded only later."""
    now = {name: loaded.get(name) or provenance.installed(name) for name in then}
    return [f"{name} {then[name]} then, {now[name]} now" for name in then if now[name] != then[name]]
