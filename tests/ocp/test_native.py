"""Functions in machine code against the virtual machine, and what happens where they cannot be had."""

from __future__ import annotations

import os
import shutil
import stat
import time

import casadi as ca
import numpy as np
import pytest
from examples import compiled, number, stiffening

from backsight.ocp.called import Called
from backsight.ocp.moving import native as module
from backsight.ocp.moving.native import cache, native
from backsight.ocp.moving.stage import Stage

with_compiler = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler here")


@pytest.fixture
def environment(tmp_path):
    return {"PATH": os.environ.get("PATH", ""), "XDG_CACHE_HOME": str(tmp_path / "cache")}


@pytest.fixture(scope="module")
def functions():
    """Of a stage with an algebraic variable, a lag and friction."""
    dae = compiled(stiffening())
    parameters = np.array([p.value for p in dae.parameters])
    stage = Stage(dae, number(dae, "mass.m", "friction.f_c"), parameters, tuple(range(dae.w.shape[0])), 2)
    y = 0.1 + np.zeros(stage.interpolation.local + 2)
    d = np.concatenate([[0.01], 1 + np.zeros(stage.numbers - 1)])
    forward, backward, _ = stage.links((y, np.ones(2), d))
    return [forward, backward, stage.residuals, stage.balances]


def script(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


@with_compiler
def test_machine_code_gives_what_the_virtual_machine_gives(functions, environment):
    fast, why = native(functions, environment)
    assert not why
    assert all(f.is_a("External") for f in fast)
    rng = np.random.default_rng(0)
    for f, g in zip(functions, fast, strict=True):
        for _ in range(20):
            given = [rng.uniform(0.1, 2.0, (f.size1_in(i), f.size2_in(i))) for i in range(f.n_in())]
            for a, b in zip(f.call([ca.DM(a) for a in given]), g.call([ca.DM(a) for a in given]), strict=True):
                np.testing.assert_allclose(np.array(b), np.array(a), rtol=1e-12, atol=1e-12)
    f, g = Called(functions[2].map(7)), Called(fast[2].map(7))
    given = [rng.uniform(0.1, 2.0, (functions[2].size1_in(i), 7)) for i in range(3)]
    for a, b in zip(f(*given), g(*given), strict=True):
        np.testing.assert_allclose(b, a, rtol=1e-12, atol=1e-12)


@with_compiler
def test_what_was_compiled_is_kept_and_what_is_damaged_made_anew(functions, environment, monkeypatch):
    native(functions, environment)
    (library,) = cache(environment).iterdir()  # and nothing half-written beside it
    first = library.stat()
    assert stat.S_IMODE(cache(environment).stat().st_mode) == 0o700
    native(functions, environment)
    assert library.stat().st_ino == first.st_ino
    native(functions[:1], environment)
    assert len(list(cache(environment).iterdir())) == 2
    library.unlink()  # it is in use: a new file, not other bytes in this one
    library.write_bytes(b"no library")
    fast, why = native(functions, environment)
    assert not why
    assert library.stat().st_size == first.st_size
    assert len(fast) == 4
    left = cache(environment) / "new-left"
    left.mkdir()
    os.utime(left, (time.time() - 1e5,) * 2)
    monkeypatch.setattr(module, "KEPT", 1)
    native(functions[1:2], environment)
    assert len(list(cache(environment).iterdir())) == 1


def test_without_a_compiler_or_where_it_fails_the_functions_are_and_it_is_said_why(functions, environment, tmp_path, monkeypatch):
    assert native(functions, {**environment, "PATH": str(tmp_path)}) == (
        functions,
        "there is no C compiler (cc, gcc or clang, or as CC names it)",
    )
    assert "CC" in native(functions, {**environment, "CC": "/no/compiler"})[1]
    failing = script(tmp_path / "failing", "echo 'stage.c: out of luck' >&2; exit 1")
    same, why = native(functions, {**environment, "CC": failing})
    assert same == functions
    assert why.endswith("failing failed: stage.c: out of luck")
    slow = script(tmp_path / "slow", "exec sleep 20")
    monkeypatch.setattr(module, "PATIENCE", 0.1)
    assert native(functions, {**environment, "CC": slow})[1].endswith("slow took longer than 0.1 s")
    assert list(cache(environment).iterdir()) == []


def test_a_cache_that_cannot_be_written_is_no_error(functions, environment, tmp_path):
    (tmp_path / "file").write_text("")
    same, why = native(functions, {**environment, "CC": "true", "XDG_CACHE_HOME": str(tmp_path / "file")})
    assert same == functions
    assert "Not a directory" in why
    same, why = native(functions, {**environment, "CC": "true"})  # a compiler that leaves nothing
    assert same == functions
    assert "No such file" in why


@with_compiler
@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owner here")
def test_a_library_that_others_may_have_written_is_not_loaded(functions, environment):
    native(functions, environment)
    folder = cache(environment)
    for path in folder.glob("*.so"):
        path.write_bytes(b"somebody else's")
    folder.chmod(0o777)
    same, why = native(functions, environment)
    assert same == functions
    assert "writable for others" in why
    folder.chmod(0o700)
    for path in folder.glob("*.so"):
        path.chmod(0o666)
    assert native(functions, environment)[1] == ""  # it was built anew


def test_a_compiler_that_cannot_be_read_is_said(functions, environment):
    assert native(functions, environment | {"CC": 'gcc -DX="a'})[1].startswith("CC=")
