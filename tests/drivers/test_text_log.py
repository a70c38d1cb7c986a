from __future__ import annotations

import bz2
import gzip
import zlib

import pytest

from drivers.text_log import TextLog, first_lines

TEXT = b"".join(b"line %d of %d\n" % (n, n * n * 7919 % 10007) for n in range(200_000))


@pytest.mark.parametrize("pack", [bytes, gzip.compress, bz2.compress])
def test_lines_are_the_same_however_the_file_is_compressed(pack, tmp_path):
    path = tmp_path / "log"
    path.write_bytes(pack(TEXT))
    log = TextLog(path)
    assert b"".join(log.lines()) == TEXT
    assert log.damage == ""
    assert first_lines(path)[:2] == TEXT.splitlines()[:2]


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_cut_archive_gives_its_beginning_and_says_so_each_time(pack, tmp_path):
    path = tmp_path / "log"
    packed = pack(TEXT)
    path.write_bytes(packed[: len(packed) * 2 // 3])
    log = TextLog(path)
    for _ in range(2):
        got = b"".join(log.lines())
        assert TEXT.startswith(got)
        assert len(got) > 100_000
        assert log.damage.startswith("cut or damaged")


@pytest.mark.parametrize("content", [b"", b"a\0b\n", b"\x1f\x8bnot gzip", b"BZhnot bzip2", zlib.compress(b"x\0" * 99)])
def test_what_is_no_text_has_no_first_lines(content, tmp_path):
    path = tmp_path / "log"
    path.write_bytes(content)
    assert first_lines(path) == []
    assert first_lines(tmp_path / "missing") == []
    assert first_lines(tmp_path) == []
