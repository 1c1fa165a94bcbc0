"""A lab with new keys, and processes that take part in it until the measurement ends."""

import multiprocessing
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing.queues import Queue
from pathlib import Path
from typing import Any

from formation.config import LabConfig
from gcs.security.bundle import install_bundle, write_bundle
from gcs.security.key_folder import KeyFolder
from wire.config_file import dump, load

READY_S = 60.0
Role = Callable[..., None]
"""What a process does: the first argument is where it puts what it has to say, the first of it when it is ready."""

_LAB = {
    "name": "lab",
    "leader": {"body": "lead", "sysid": 1},
    "followers": [{"body": "left", "sysid": 2, "offset_m": [-0.5, 0.5, 0.0]}],
    "security": {"addresses": ["127.0.0.1"], "operators": {"board": "viewer"}},
}


@dataclass(frozen=True, slots=True)
class KeyedLab:
    """A lab file and its keys; the ground listens at every address of this machine, as for drones on a network."""

    file: Path
    keys: Path
    port: int

    @property
    def listen(self) -> str:
        """Where the ground listens."""
        return f"tls/0.0.0.0:{self.port}"

    @property
    def from_network(self) -> str:
        """The same listener, as others reach it."""
        return f"tls/127.0.0.1:{self.port}"


def keyed_lab(folder: Path, port: int) -> KeyedLab:
    """Write a lab file and make its keys in a folder."""
    lab = LabConfig.model_validate(
        _LAB | {"link": {"zenoh_listen": [f"tls/0.0.0.0:{port}"], "zenoh_connect": []}}
    )  # fmt: skip
    file = folder / "lab.toml"
    file.write_text(dump(lab), encoding="utf-8")
    keys = KeyFolder(lab, file)
    keys.make(datetime.now(UTC))
    return KeyedLab(file, keys.path, port)


def elsewhere(lab: KeyedLab, identity: str) -> Path:
    """The lab file of another computer, which has that identity's keys alone and reaches the ground by the network."""
    folder = lab.file.parent / f"computer-of-{identity}"
    install_bundle(_bundle(lab, identity), folder / "keys")
    file = folder / lab.file.name
    values = _LAB | {"link": {"zenoh_listen": [], "zenoh_connect": [lab.from_network]}}
    file.write_text(dump(LabConfig.model_validate(values)), encoding="utf-8")
    return file


def _bundle(lab: KeyedLab, identity: str) -> Path:
    path = lab.file.parent / f"{identity}.keys"
    config = load(lab.file, LabConfig)
    write_bundle(path, identity, KeyFolder(config, lab.file).files(identity, datetime.now(UTC)))
    return path


@contextmanager
def participant(role: Role, *arguments: object) -> Iterator["Queue[Any]"]:
    """While inside, another process does its part; what it says after that it is ready comes by the queue."""
    context = multiprocessing.get_context("spawn")
    queue: Queue[Any] = context.Queue()
    process = context.Process(target=role, args=(queue, *arguments), daemon=True)
    process.start()
    try:
        queue.get(timeout=READY_S)
        yield queue
    finally:
        process.kill()
        process.join()
        queue.close()
