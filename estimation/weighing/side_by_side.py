"""What a study asks of many solves, so many at once: whether each weight may be none, and what every setting gives."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..workers import as_finished
from .estimated import without_line
from .plan import once
from .setting import Outcome, Setting, Stand, solve
from .store import Store
from .turned import Mask

Progress = Callable[[str], None]
Doubt = Callable[[], tuple[float, float]]
Call = tuple[Callable[[Any], None], Callable[[], Any]]  # who takes the result, and what gives it


def side_by_side(
    doubts: Mapping[str, Doubt],
    doubted: str,
    stand: Callable[[], Stand],
    chains: list[list[Setting]],
    pool: Executor,
    ahead: int,
    keep: Path | None,
    say: Progress,
) -> tuple[dict[str, tuple[float, float]], list[Outcome]]:
    """Label of a weight -> p that it is none and its limit; all settings, kept ones and others, those of one theta solved once.

    doubted: what the doubts hang on. stand: asked for when these are under way. One queue for both: nobody waits for the last of the
    doubts before the first setting.
    """
    store, solved = Store(keep, doubted), dict[tuple[float, ...], Outcome]()
    answers = {label: told for label in doubts if (told := store.answer(label)) is not None}

    def answer(label: str, told: tuple[float, float]) -> None:
        answers[label] = told
        store.put_answer(label, told)
        say(without_line(label, told))

    def calls() -> Iterator[Call]:
        yield from ((partial(answer, label), doubt) for label, doubt in doubts.items() if label not in answers)
        yield from _settings(stand(), chains, keep, solved, say)

    for take, result in as_finished(pool, calls(), ahead):
        take(result)
    return {label: answers[label] for label in doubts}, [replace(solved[s.theta], setting=s) for s in chain.from_iterable(chains)]


def _settings(
    stand: Stand, chains: list[list[Setting]], keep: Path | None, solved: dict[tuple[float, ...], Outcome], say: Progress
) -> Iterator[Call]:
    """What is left to solve when those that were kept are in `solved`, where all others go as well."""
    blob, apart = pickle.dumps(stand), once(chains)
    store, number = Store(keep, stand.identity), sum(map(len, apart))
    solved |= {s.theta: kept for s in chain.from_iterable(apart) if (kept := store.get(s)) is not None}
    left = [c for c in apart if any(s.theta not in solved for s in c)]  # whole: what a chain gives hangs on where it came from
    left.sort(key=partial(_quick, stand.fitted.noise))

    def take(outcomes: list[Outcome]) -> None:
        for outcome in outcomes:
            store.put(outcome)
            solved[outcome.setting.theta] = outcome
            say(f"setting {len(solved)} of {number}")

    say(f"setting {len(solved)} of {number}")
    yield from ((take, partial(solve, blob, c)) for c in left)


def _quick(noise: Mask, chain: list[Setting]) -> tuple[bool, int, float]:
    """The lower, the longer a chain may take, and the sooner it begins: samples that must be followed more closely take more steps."""
    return chain[0].group != "candidate", -len(chain), min(float(np.min(np.array(s.theta)[noise], initial=np.inf)) for s in chain)
