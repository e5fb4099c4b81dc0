"""A diagnosis in words: one sentence for the verdict, and short ones for numbers that the terminal and the page share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ...wording import capitalised, listed, measured, probability
from .verdict import EVERYWHERE, TOO_SMALL, Diagnosis, Explanation, Finding, HeldOut, Strength, Tried

CONTRADICTED = "What was held out contradicts the repair: it fits the one recording and mispredicts the other."
UNPROVED = (
    "What was held out is predicted no better with the repair than chance would have it, and much is left over beside it: it may stand for "
    "something else."
)
HARDLY_BETTER = "what was held out is predicted hardly better with it, or by chance, and it acts from some time on, or for a while"
KINDS = {
    "parameter": "A given value is wrong:",
    "sensor": "A sensor does not read what the model supposes:",
    "actuator": "An input does not act as it was recorded:",
}  # family -> how what was found is said
LEFT_OUT = "The model leaves out"
CHANGE = "A parameter changes while the machine runs:"
STANDING_OUT = 10.0  # nats, of an effect that is too small to matter: with as much it is told of, for it is there
NAMED = 3  # of what recordings cannot tell apart
FEW_BLOCKS = 5  # of what was held out: however plain a gain is, so few cannot make its chance small
UNKNOWN = "unknown_physics"  # of a force that no member of the library explains


def withdrawn(findings: Sequence[Finding], held_out: HeldOut) -> str:
    """What was found by little evidence, and went out of the model again since what was held out speaks against it, or not for it."""
    named = [f for f in findings if f.explanation.physics != UNKNOWN]
    told = [f"{f.explanation.words} ({p})" if (p := probability(f.p_value)) else f.explanation.words for f in named]
    return f"Not borne out: {listed(told)}, by what was fitted. {capitalised(speaking_against(held_out))}."


def taken_out(finding: Finding, held_out: HeldOut) -> str:
    """One of several effects that went out of the model again. held_out: of the model without it, against that with it."""
    found = f"{capitalised(finding.explanation.words)} was found, {finding.gain:.3g} nats, and is not in the repaired model"
    chance = f" ({p})" if held_out.improvement_percent < 0 and (p := probability(1.0 - held_out.p_value)) else ""
    return f"{found}: {speaking_against(held_out)}{chance}. So what was held out has had its say on the repair."


def speaking_against(held_out: HeldOut) -> str:
    """What was held out says against an effect."""
    if held_out.improvement_percent < 0:
        return f"of what was held out prediction errors are {-held_out.improvement_percent:.3g} % larger with it"
    return HARDLY_BETTER


def repairs(found: Diagnosis) -> bool:
    """Whether anything that has a name was found, and put into the model."""
    return any(f.explanation.physics != UNKNOWN for f in found.findings)


def sentence(found: Diagnosis) -> str:
    """The verdict: The model leaves out coulomb friction at carriage (f_c = 20.31 ± 0.12 N). Held out: prediction errors 71 % smaller."""
    return f"{_verdict(found)}{gain(found.held_out)}{_untold(found)}"


def _verdict(found: Diagnosis) -> str:
    names = [named(f.explanation) for f in found.findings]
    if found.verdict == "none" or not names:
        if found.verdict in ("none", "parameter", "sensor", "input", "missing_physics"):
            if small := _small(found.tried):
                return f"Nothing that matters is missing: what stands out, {named(small)}, is less than 1 % of what acts there."
            return "Nothing is missing: no effect in the library stands out of these recordings."
        return "Whether anything is missing was not found out; the notes say why."
    match found.verdict:
        case "unknown_physics":
            nameless = [f for f in found.findings if f.explanation.physics == UNKNOWN] or list(found.findings)
            others = [named(f.explanation) for f in found.findings if f not in nameless]
            beside = f", beside {listed(others)}" if others else ""
            there = [[_where(f.explanation), *(r.place for r in f.rivals if r.physics == UNKNOWN)] for f in nameless]
            where = listed(list(dict.fromkeys(" or ".join(places) for places in there)))
            goes = "".join(f" Of the mean square of that force go {f.described}." for f in nameless if f.described)
            return f"Something is missing at {where} that no member of the library explains{beside}.{goes}"
        case "undecided":
            if found.held_out is not None and found.held_out.refuting:
                return f"Something is missing, and {listed(names)} would explain it where it was fitted alone."
            rivals = [e.words for f in found.findings for e in (f.explanation, *f.rivals)]
            return f"Something is missing, and these recordings cannot tell which it is: {listed(list(dict.fromkeys(rivals)))}."
    return " ".join(_clauses(found.findings))


def _untold(found: Diagnosis) -> str:
    """Of every finding what these recordings do not tell it from, the first few of many; nothing where the verdict says so."""
    told = ""
    for f in found.findings if found.verdict not in ("unknown_physics", "undecided") else ():
        if f.rivals:
            some, more = [r.words for r in f.rivals[:NAMED]], len(f.rivals) - NAMED
            rest = [f.rivals[-1].words] if more == 1 else [f"one of {more} more"] if more > 1 else []
            told += f" In the place of {f.explanation.words} it may be {' or '.join([*some, *rest])}: these recordings cannot tell."
    return told


def _small(tried: Sequence[Tried]) -> Explanation | None:
    """The effect with most evidence of those that were refused for their size."""
    there = [(t.fitted, t.explanation) for t in tried if t.refused == TOO_SMALL and t.fitted is not None and t.fitted > STANDING_OUT]
    return max(there, key=lambda one: one[0])[1] if there else None


def _where(nameless: Explanation) -> str:
    """The place of a force without a name, and which of its balances."""
    balances = [word for word in nameless.parameters if word != "rms"] if nameless.physics == UNKNOWN else []
    return f"{nameless.place} ({listed(balances)})" if balances else nameless.place


def _clauses(findings: Sequence[Finding]) -> list[str]:
    """What was found, a sentence for every kind of it."""
    kinds: dict[str, list[str]] = {}
    for f in findings:
        e = f.explanation
        own = numbers(e.parameters) or e.place if e.family == "parameter" else named(e)
        kind = LEFT_OUT if e.family == "actuator" and not e.place.startswith("input:") else KINDS.get(e.family, LEFT_OUT)
        kinds.setdefault(CHANGE if e.changes else kind, []).append(f"{own} {when(f)}" if e.changes else own)
    return [f"{kind} {listed(own)}." for kind, own in kinds.items()]


def named(explanation: Explanation) -> str:
    """Coulomb friction at carriage (f_c = 20.31 ± 0.12 N); wrong parameter screw.lead = 5.02 ± 0.01 mm."""
    strengths = numbers(explanation.parameters)
    if explanation.changes and strengths:
        return strengths
    if explanation.subject and strengths:
        return f"{explanation.physics.replace('_', ' ')} {strengths}"
    return f"{explanation.words} ({strengths})" if strengths else explanation.words


def numbers(parameters: Mapping[str, Strength]) -> str:
    """f_c = 20.31 ± 0.12 N, v_s = 0.0102 ± 0.0011 m/s."""
    return ", ".join(f"{name} = {with_deviation(s)}" for name, s in parameters.items())


def with_deviation(s: Strength) -> str:
    """20.31 ± 0.12 N: two digits of the deviation; five of a value without one."""
    unit = f" {s.unit}" if s.unit not in ("", "1") else ""
    if s.std is None or not (math.isfinite(s.std) and s.std > 0):
        return f"{s.value:.5g}{unit}"
    value, std = measured(s.value, s.std)
    return f"{value} ± {std}{unit}"


def gain(held: HeldOut | None) -> str:
    """What the repair is worth on what was held out."""
    if held is None or not math.isfinite(held.improvement_percent):
        return ""
    size, where = held.improvement_percent, listed(held.recordings) or held.role
    less = f"{abs(size):.3g} % {'smaller' if size >= 0 else 'larger'}"
    of = f" from {held.blocks} stretches" if held.blocks < FEW_BLOCKS else ""
    told = f" ({p}{of})" if (p := probability(held.p_value)) else ""
    return f" On {where}, which the fit has not seen, prediction errors are {less} with it{told}." if size else ""


def when(finding: Finding) -> str:
    """From 2.4 s on, forwards."""
    until = "on" if finding.until is None else f"to {finding.until:.4g} s"
    since = "" if finding.onset is None else f"from {finding.onset:.4g} s {until}"
    there = "" if since and finding.regime == EVERYWHERE else finding.regime
    return ", ".join(part for part in (since, there) if part)
