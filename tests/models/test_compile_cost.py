"""What compiling costs grows as the model does: counted, not timed, but for the last test."""

import time

import casadi as ca
import numpy as np
import pytest
from chains import gear_train, mass_chain

from backsight.models import Model, compile_model, simulate
from backsight.models.compilation.eliminate import Eliminator
from backsight.models.compilation.flatten import flatten


def work(model: Model) -> int:
    """Symbols in the rows that elimination rewrites."""
    eliminator = Eliminator(flatten(model), set(model.inputs.values()), {}, kept=[o.variable for o in model.measured.values()])
    eliminator.run()
    return eliminator.rows.work


def test_every_further_mass_costs_as_much_as_the_one_before() -> None:
    small, middle, large = (work(mass_chain(size)) for size in (6, 12, 24))
    assert large - middle == 2 * (middle - small) > 0


def test_every_further_gear_makes_the_equation_longer_by_as_much() -> None:
    def length(size: int) -> int:
        residual = compile_model(gear_train(size)).residual
        return int(ca.Function("f", [ca.vertcat(*ca.symvar(residual))], [residual]).n_instructions())

    small, middle, large = (length(size) for size in (6, 12, 24))
    assert large - middle == 2 * (middle - small) > 0


def test_a_long_gear_train_is_the_reduced_inertia() -> None:
    size, ratio, torque = 40, 1.05, 3.0
    dae = compile_model(gear_train(size, ratio))
    assert [q.name for q in dae.states] == [f"inertia_{size}.phi", f"inertia_{size}.omega"]
    inertia = sum((1.0 + i / size) * ratio ** (2 * (size - i)) for i in range(1, size + 1))
    run = simulate(dae, [0.0, 1.0], {"T": torque})
    assert run.outputs["phi"][-1] == pytest.approx(0.5 * torque * ratio ** (size - 1) / inertia, rel=1e-8)


def test_a_long_chain_of_masses_has_the_textbook_mass_and_stiffness() -> None:
    size = 30
    dae = compile_model(mass_chain(size))
    names = [q.name for q in dae.states]
    rows = ca.Function("rows", [dae.dx, dae.x, dae.u, dae.p, dae.w], [ca.jacobian(dae.residual, dae.dx), ca.jacobian(dae.residual, dae.x)])
    zero = [0.0] * len(names)
    mass, force = (np.array(m) for m in rows(zero, zero, [0.0], dae.parameter_values(), [0.0] * len(dae.places)))
    order = [dae.equations.index(next(e for e in dae.equations if e.origin == f"force balance of mass_{i + 1}")) for i in range(size)]
    springs = 2 * np.eye(size) - np.eye(size, k=1) - np.eye(size, k=-1)
    springs[0, 0] = springs[-1, -1] = 1.0
    s, v = ([names.index(f"mass_{i + 1}.{letter}") for i in range(size)] for letter in "sv")
    assert mass[np.ix_(order, v)] == pytest.approx(np.diag([1.0 + (i + 1) / size for i in range(size)]))
    assert force[np.ix_(order, s)] == pytest.approx(10.0 * springs)
    assert force[np.ix_(order, v)] == pytest.approx(0.1 * springs)


@pytest.mark.slow
def test_four_times_the_masses_take_less_than_quadratically_longer() -> None:
    def seconds(size: int) -> float:
        began = time.process_time()
        compile_model(mass_chain(size))
        return time.process_time() - began

    seconds(20)
    assert seconds(200) < 16 * seconds(50)
