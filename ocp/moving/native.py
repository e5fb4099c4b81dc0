"""C code of CasADi functions, compiled once and kept: some ten times as fast as CasADi's virtual machine, to the same last digits or so.

CasADi's own option "jit" compiles anew at every start, into the folder where one stands; this keeps what was compiled in the user's cache
under a hash of the source and of the compiler's command.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca

# for a stage of 22,000 operations, to compile it and to run it: -Og 2.6 s, 6.8 us; -O1 4.4 s, 6.2 us; -O2 5 s, 6.0 us; -O0 0.9 s, 20 us;
# the virtual machine 69 us
# no contraction: a multiplication and an addition are rounded each, as in the virtual machine
FLAGS = ("-Og", "-ffp-contract=off", "-fPIC", "-shared")
PATIENCE = 60.0  # s that a compiler may take
KEPT = 100  # libraries in the cache; the ones longest unused go


def native(functions: Sequence[Any], environment: Mapping[str, str] = os.environ) -> tuple[list[Any], str]:
    """The functions in machine code and no word, or as they are and why."""
    command = _compiler(environment)
    if not command:
        return list(functions), "there is no C compiler (cc, gcc or clang, or as CC names it)"
    generator = ca.CodeGenerator("stage.c")
    for function in functions:
        generator.add(function)
    source = generator.dump()
    key = hashlib.sha256("\0".join((source, *command, *FLAGS, platform.machine(), platform.system())).encode()).hexdigest()
    try:
        library = cache(environment) / f"{key[:32]}.so"
        if library.is_file():
            with contextlib.suppress(RuntimeError, OSError):  # it is damaged, or another user's
                library.touch()
                return _loaded(functions, library), ""
        _compile(source, [*command, *FLAGS], library)
        return _loaded(functions, library), ""
    except subprocess.TimeoutExpired:
        return list(functions), f"{command[0]} took longer than {PATIENCE:g} s"
    except subprocess.CalledProcessError as e:
        said = (e.stderr or b"").decode(errors="replace").strip().splitlines()
        return list(functions), f"{command[0]} failed" + (f": {said[0]}" if said else "")
    except (OSError, RuntimeError) as e:
        return list(functions), str(e).strip().splitlines()[-1] if str(e).strip() else type(e).__name__


def cache(environment: Mapping[str, str] = os.environ) -> Path:
    """Where libraries are kept: $XDG_CACHE_HOME/backsight, or ~/.cache/backsight."""
    given = environment.get("XDG_CACHE_HOME", "")
    return (Path(given) if given else Path.home() / ".cache") / "backsight"


def _compiler(environment: Mapping[str, str]) -> list[str]:
    words = shlex.split(environment.get("CC", ""))
    candidates = [words] if words else [["cc"], ["gcc"], ["clang"]]
    return next((c for c in candidates if shutil.which(c[0], path=environment.get("PATH"))), [])


def _loaded(functions: Sequence[Any], library: Path) -> list[Any]:
    return [ca.external(function.name(), str(library)) for function in functions]


def _compile(source: str, command: list[str], library: Path) -> None:
    """Compile beside where the library is to be and move it there whole; sweep away what is no longer used."""
    library.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.TemporaryDirectory(dir=library.parent, prefix="new-") as folder:
        code, made = Path(folder) / "stage.c", Path(folder) / "stage.so"
        code.write_text(source, encoding="utf-8")
        subprocess.run([*command, str(code), "-o", str(made), "-lm"], check=True, capture_output=True, timeout=PATIENCE)
        os.replace(made, library)
    for old in sorted(library.parent.glob("*.so"), key=lambda path: path.stat().st_mtime)[:-KEPT]:
        old.unlink(missing_ok=True)
    for left in library.parent.glob("new-*"):  # by a process that was killed
        if time.time() - left.stat().st_mtime > 10 * PATIENCE:
            shutil.rmtree(left, ignore_errors=True)
