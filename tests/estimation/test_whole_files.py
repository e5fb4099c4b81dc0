"""What is written whole or not at all."""

from __future__ import annotations

import os

import pytest

from backsight.estimation.whole_files import written_whole


def test_a_file_takes_the_place_of_the_old_one_when_it_is_complete(tmp_path):
    path = tmp_path / "state"
    path.write_bytes(b"old")
    with written_whole(path) as file:
        file.write(b"new")
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"
    assert [p.name for p in tmp_path.iterdir()] == ["state"]


@pytest.mark.parametrize("cut", [ValueError, KeyboardInterrupt])
def test_what_is_cut_short_leaves_the_old_file_and_nothing_else(tmp_path, cut):
    path = tmp_path / "state"
    path.write_bytes(b"old")

    def cut_short():
        with written_whole(path) as file:
            file.write(b"ne")
            raise cut

    with pytest.raises(cut):
        cut_short()
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["state"]


@pytest.mark.skipif(os.name == "nt", reason="permissions of POSIX")
@pytest.mark.parametrize(("mask", "mode"), [(0o022, 0o644), (0o027, 0o640), (0o077, 0o600)])
def test_others_may_read_it_as_the_umask_says(tmp_path, mask, mode):
    before = os.umask(mask)
    try:
        with written_whole(tmp_path / "state") as file:
            file.write(b"new")
    finally:
        assert os.umask(before) == mask
    assert (tmp_path / "state").stat().st_mode & 0o777 == mode
