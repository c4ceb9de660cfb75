"""Damaged files: what a cut download, a bad disk or a hostile sender makes of a good file."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from goc.errors import FileError

_NASTY = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FFFFFFFFFFFFFFF, 0xFFFFFFFFFFFFFFFF]
_NASTY_WORDS = [b"-1", b"0", b"999999999999", b"1e999", b"nan", b"4294967296", b"1_0", b"\x00", b"[" * 2000, b'"', b"{"]


def mutants(data: bytes, count: int, seed: int) -> Iterator[bytes]:
    """`count` damaged versions of `data`, the same for the same seed."""
    random = np.random.default_rng(seed)
    for number in range(count):
        damaged = bytearray(data)
        for _ in range(random.integers(1, 4)):
            _damage(damaged, random, number % 6)
        yield bytes(damaged)


def _damage(data: bytearray, random: np.random.Generator, kind: int) -> None:
    # half of the damage goes to the start of the file, where the header says what follows
    reach = len(data) if random.random() < 0.5 else min(len(data), 400)
    place = int(random.integers(0, max(reach, 1)))
    match kind:
        case 0:
            del data[place:]
        case 1:
            for at in random.integers(0, max(reach, 1), 8) if data else ():
                data[at] ^= 1 << int(random.integers(8))
        case 2:
            digits = [found.start() for found in re.finditer(rb"\d", bytes(data[:reach]))]
            if digits:
                data[random.choice(digits)] = ord(str(random.integers(10)))
        case 3:
            data[place : place + 8] = random.choice(np.array(_NASTY, np.uint64)).tobytes()
        case 4:
            data[place:place] = _NASTY_WORDS[random.integers(len(_NASTY_WORDS))]
        case 5:
            del data[place : place + int(random.integers(1, 40))]


def assert_only_file_errors(read: Callable[[Path], object], good: Path, count: int = 300, seed: int = 0) -> None:
    """Read mutants of a good file: each gives a value, or a FileError of one line that names the file."""
    read(good)
    damaged = good.with_name(f"damaged{good.suffix}")
    refused = 0
    for mutant in mutants(good.read_bytes(), count, seed):
        damaged.write_bytes(mutant)
        try:
            read(damaged)
        except FileError as error:
            refused += 1
            text = str(error)
            assert str(damaged) in text
            assert "\n" not in text
            assert len(text) < 500
    assert refused > count // 10
