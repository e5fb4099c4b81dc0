"""Model edits: a component added at a place (on a flange, across an element, into an input, behind a sensor), exchanged, or bridged."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from .changes import changes_where
from .errors import ModelError, suggestion
from .language import Component, Connector, SignalInput, SignalOutput
from .model import GROUNDS, Model, Output


def insert(model: Model, place: str, component: Component, name: str | None = None) -> Model:
    """The model with `component` at `place`; see `Model.insert`."""
    name = name or _free_name(model, type(component).__name__.lower())
    if name in model.components:
        raise ModelError(f"insert at '{place}': the model already has a component '{name}'; choose another name or use replace()")
    what, colon, signal = place.partition(":")
    if colon:
        return _insert_block(model, what, signal, component, name)
    return _insert_element(model, place, component, name)


def idle_grounds(model: Model, kept: Sequence[tuple[str, str]]) -> set[str]:
    """Grounds that held something and hold nothing once only the connections `kept` are left."""

    def joined(connections: Sequence[tuple[str, str]]) -> set[str]:
        return {end.partition(".")[0] for pair in connections for end in pair}

    grounds = tuple(GROUNDS.values())
    idle = joined(model.connections) - joined(kept)
    return {name for name, c in model.components.items() if isinstance(c, grounds) and name in idle}


def exchange(model: Model, name: str, component: Component) -> Model:
    """The model with the component `name` exchanged; see `Model.replace`."""
    old = model.component(name)
    call = f"replace('{name}', {type(component).__name__}(...))"
    known = {
        f"{name}.{word}"
        for table in (component.declared_connectors, component.declared_signals, component.declared_variables)
        for word in table
    }
    known |= {f"{name}.{p}.{w}" for p, c in component.declared_connectors.items() for pair in c.pairs for w in (pair.potential, pair.flow)}
    used = {end: "the model connects" for pair in model.connections for end in pair}
    used |= {variable: f"input '{signal}' drives" for signal, variable in model.inputs.items()}
    used |= {output.variable: f"output '{signal}' measures" for signal, output in model.measured.items()}
    for path, use in used.items():
        if path.partition(".")[0] == name and path not in known:
            raise ModelError(
                f"{call}: {use} '{path}' of {type(old).__name__} '{name}', which {type(component).__name__} lacks; "
                "choose a component that has it, or remove what uses it first"
            )
    for path, to in model.bindings.items():
        owner, _, word = path.partition(".")
        declared = component.declared_parameters.get(word)
        if owner == name and declared and component.parameters[word] not in (declared.default, model.parameters[to].default):
            raise ModelError(
                f"{call}: {path} is bound to {to}, so its value {component.parameters[word]:g} would have no effect; leave it out, and "
                f"set {to} by with_values() if it is to change"
            )

    def stays(path: str) -> bool:
        return path.partition(".")[0] != name or path in known

    def declared_still(path: str) -> bool:
        owner, _, word = path.partition(".")
        return owner != name or word in component.declared_parameters

    return replace(
        model,
        components={**model.components, name: component},
        bindings={path: to for path, to in model.bindings.items() if declared_still(path)},
        onsets={path: onset for path, onset in model.onsets.items() if declared_still(path)},
        **changes_where(model, declared_still),
        start={path: value for path, value in model.start.items() if stays(path)},
        states=tuple(path for path in model.states if stays(path)),
    )


def bridged(model: Model, name: str) -> Model | None:
    """The model with what goes into a block (one signal input, one signal output, no flange) going where its output goes.

    None for anything else, and for a block that nothing goes into or comes out of.
    """
    block = model.component(name)
    into, out = _signals(block)
    if len(into) != 1 or len(out) != 1 or block.declared_connectors:
        return None
    u, y = f"{name}.{into[0]}", f"{name}.{out[0]}"
    driven, measured = u in model.inputs.values(), any(output.variable in (u, y) for output in model.measured.values())
    told = [b if a == u else a for a, b in model.connections if u in (a, b)]
    tells = [b if a == y else a for a, b in model.connections if y in (a, b)]
    ends = [end for end in (*told, *tells) if end not in (u, y)]
    if not ends or not (driven or measured or (told and tells)):
        return None

    def moved(path: str) -> str:
        return ends[0] if path in (u, y) else path

    joined = dict.fromkeys((moved(a), moved(b)) for a, b in model.connections)
    return replace(
        model,
        connections=tuple((a, b) for a, b in joined if a != b),
        inputs={signal: moved(variable) for signal, variable in model.inputs.items()},
        outputs={signal: Output(moved(output.variable), output.noise_std) for signal, output in model.measured.items()},
    )


def _signals(block: Component) -> tuple[list[str], list[str]]:
    """Names of its signal inputs and outputs."""
    into = [word for word, s in block.declared_signals.items() if isinstance(s, SignalInput)]
    return into, [word for word, s in block.declared_signals.items() if isinstance(s, SignalOutput)]


def _insert_element(model: Model, place: str, component: Component, name: str) -> Model:
    kinds = {type(connector) for connector in component.declared_connectors.values()}
    owner, dot, _ = place.partition(".")
    every = {place: model.connector(place)} if dot else {f"{owner}.{w}": c for w, c in model.component(owner).declared_connectors.items()}
    ports = [path for path, connector in every.items() if type(connector) in kinds]
    own = [f"{name}.{port}" for port in component.declared_connectors]
    if len(kinds) > 1:
        raise ModelError(
            f"insert at '{place}': {type(component).__name__} has {' and '.join(sorted(k.__name__ for k in kinds))} flanges, so it stands "
            "between two places; add it to components and connect both sides"
        )
    if own and not ports:
        there = ", ".join(sorted({type(c).__name__ for c in every.values()})) or "without flanges"
        raise ModelError(
            f"insert at '{place}': {type(component).__name__} has {next(iter(kinds)).__name__} flanges, the place is {there}; "
            "choose the component for that kind"
        )
    grown = replace(model, components={**model.components, name: component})
    if len(ports) == len(own) and len(own) in (1, 2):
        return replace(grown, connections=(*grown.connections, *zip(ports, own, strict=True)))
    if len(ports) == 1 and len(own) == 2:
        grown, ground = _ground(grown, kinds.pop())
        return replace(grown, connections=(*grown.connections, (ports[0], own[0]), (own[1], ground)))
    options = " or ".join(f"'{port}'" for port in ports)
    raise ModelError(
        f"insert at '{place}': {type(component).__name__} has {len(own)} flange(s), the place has {len(ports)}; "
        + (f"name one flange: {options}" if ports else "choose a component with flanges")
    )


def _insert_block(model: Model, what: str, signal: str, block: Component, name: str) -> Model:
    """The block between a model input and what it drives, or between what a sensor reads and the output."""
    into, out = _signals(block)
    if len(into) != 1 or len(out) != 1 or block.declared_connectors:
        raise ModelError(
            f"insert at '{what}:{signal}': {type(block).__name__} has {len(into)} signal input(s), {len(out)} signal output(s) and "
            f"{len(block.declared_connectors)} flange(s); a block with one input, one output and no flange is needed"
        )
    u, y = f"{name}.{into[0]}", f"{name}.{out[0]}"
    known = {"input": model.inputs, "sensor": model.outputs}.get(what)
    if known is None:
        raise ModelError(f"insert at '{what}:{signal}': a place with a colon begins with 'input:' or 'sensor:'; use one of these")
    if signal not in known:
        raise ModelError(f"insert at '{what}:{signal}': model '{model.name}' has no such {what}; {suggestion(signal, known)}")
    components = {**model.components, name: block}
    if what == "input":
        driven = model.inputs[signal]
        grown = replace(model, components=components, inputs={**model.inputs, signal: u})
        return replace(grown, connections=(*grown.connections, (y, driven)))
    measured = model.measured[signal]
    grown = replace(model, components=components, outputs={**model.outputs, signal: Output(y, measured.noise_std)})
    return replace(grown, connections=(*grown.connections, (measured.variable, u)))


def _ground(model: Model, kind: type[Connector]) -> tuple[Model, str]:
    if kind not in GROUNDS:
        raise ModelError(f"there is no ground for {kind.__name__} flanges; connect the second flange yourself")
    ground = GROUNDS[kind]
    name = next((n for n, c in model.components.items() if isinstance(c, ground)), None)
    if name is None:
        name = _free_name(model, "ground")
        model = replace(model, components={**model.components, name: ground()})
    return model, f"{name}.{next(iter(ground.declared_connectors))}"


def _free_name(model: Model, stem: str) -> str:
    return next(name for name in _numbered(stem) if name not in model.components)


def _numbered(stem: str) -> Iterator[str]:
    yield stem
    count = 2
    while True:
        yield f"{stem}_{count}"
        count += 1
