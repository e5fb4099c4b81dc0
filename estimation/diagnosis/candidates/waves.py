"""Periods too fine to try them all: those at which what is left over waves along the way.

Teeth, poles and balls come back hundreds of times over the span of the positions. Forces summed in narrow bins of the position have a
periodogram over waves per span, and its highest peaks are worth a score. Where a machine moves too fast for its samples they add noise to
that, and no false waves: positions at the samples are known.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

PEAKS = 12
PER_WAVE = 8  # bins of the finest wave
SAMPLES = 4.0  # of a wave, at the step between samples that half of those in motion do not exceed
MOVING = 0.01  # of the largest step: with less it hardly moves
MOST = 4000.0  # waves over the span


def fine_periods(position: Array, force: Array, coarsest: float) -> tuple[float, ...]:
    """Periods [unit of position] finer than `coarsest` waves over the span at which the force (n,) waves most; none where nothing moves."""
    low, span = float(position.min()), float(np.ptp(position))
    steps = np.abs(np.diff(position))
    step = float(np.median(steps[steps > MOVING * steps.max()])) if (steps > 0).any() else 0.0
    if not span > 0 or not step > 0:
        return ()
    finest = min(span / (SAMPLES * step), MOST)
    if finest <= coarsest:
        return ()
    half = int(2 ** np.ceil(np.log2(PER_WAVE * finest)))  # bins of the span; as many empty ones make half waves
    there = np.minimum(((position - low) / span * half).astype(np.int64), half - 1)
    spectrum = np.abs(np.fft.rfft(np.bincount(there, weights=force - force.mean(), minlength=2 * half)))
    tops = np.flatnonzero((spectrum[1:-1] >= spectrum[:-2]) & (spectrum[1:-1] > spectrum[2:])) + 1
    tops = tops[(tops > 2 * coarsest) & (tops < 2 * finest)]
    best = tops[np.argsort(-spectrum[tops], kind="stable")[:PEAKS]]
    return tuple(float(2.0 * span / m) for m in best)
