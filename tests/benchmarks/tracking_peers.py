"""Moving-horizon estimators of others on a case of `tracking_cases.py`: CasADi as one writes it by hand, and do-mpc where it is installed.

All have the same cost: residual forces constant over an interval and readings over their deviations, parameters constant over the window,
and an arrival cost of fixed weights about where the estimate before had the window's first state and the parameters.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from tracking_cases import WINDOW, Case

QUIET = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}


class Plain:
    """One parametric program: direct collocation (Radau IIA) or multiple shooting (one step of RK4), Ipopt with exact derivatives.

    Competent means: SX stage functions, all unknowns in deviations, no bounds (so no barrier either), the trajectory before,
    shifted, and its multipliers as the start.
    """

    def __init__(self, case: Case, scheme: str) -> None:
        self.case, self.name = case, {"radau": "CasADi, Radau 2", "rk4": "CasADi, shooting"}[scheme]
        nx, nu, np_, nw, ny = len(case.states), case.inputs.shape[1], len(case.guesses), len(case.places), case.outputs.shape[1]
        x, u, p, w = (ca.SX.sym(n, k) for n, k in (("x", nx), ("u", nu), ("p", np_), ("w", nw)))
        self.sx, self.sp = ca.DM(case.arrival_x), ca.DM(case.arrival_p)
        real = x * self.sx, u, p * self.sp, w * ca.DM(case.force_std / np.sqrt(case.step))
        f = ca.Function("f", [x, u, p, w], [case.rates(*real) / self.sx])
        h = ca.Function("h", [x, u, p, w], [case.readings(*real) / ca.DM(case.noise_std)])
        self.inner = 2 if scheme == "radau" else 0
        c = ca.SX.sym("c", nx * self.inner)
        step = case.step
        if scheme == "radau":  # points 1/3 and 1; the last one is the end
            points, right = ca.horzcat(x, ca.reshape(c, nx, 2)), []
            C = ca.collocation_coeff(ca.collocation_points(2, "radau"))[0]
            right = [points @ C[:, j] - step * f(points[:, j + 1], u, p, w) for j in range(2)]
            link = ca.Function("link", [x, c, u, p, w], [ca.vertcat(*right), points[:, 2]])
        else:
            k1 = f(x, u, p, w)
            k2 = f(x + step / 2 * k1, u, p, w)
            k3 = f(x + step / 2 * k2, u, p, w)
            k4 = f(x + step * k3, u, p, w)
            link = ca.Function("link", [x, c, u, p, w], [ca.SX(0, 1), x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
        X, I = ca.SX.sym("X", nx, WINDOW + 1), ca.SX.sym("I", nx * self.inner, WINDOW)
        P, W = ca.SX.sym("P", np_), ca.SX.sym("W", nw, WINDOW)
        U, Y = ca.SX.sym("U", nu, WINDOW + 1), ca.SX.sym("Y", ny, WINDOW + 1)
        x_prev, p_prev = ca.SX.sym("x_prev", nx), ca.SX.sym("p_prev", np_)
        cost = ca.sumsqr(X[:, 0] - x_prev) + ca.sumsqr(P - p_prev) + ca.sumsqr(W)
        order, equal = [], []
        for k in range(WINDOW):
            inside, end = link(X[:, k], I[:, k], U[:, k], P, W[:, k])
            cost += ca.sumsqr(h(X[:, k], U[:, k], P, W[:, k]) - Y[:, k] / ca.DM(case.noise_std))
            order += [X[:, k], I[:, k], W[:, k]]
            equal += [inside, end - X[:, k + 1]]
        last = h(X[:, WINDOW], U[:, WINDOW], P, ca.SX(nw, 1)) - Y[:, WINDOW] / ca.DM(case.noise_std)
        cost += ca.sumsqr(last[list(case.prompt)])
        program = {
            "x": ca.vertcat(*order, X[:, WINDOW], P),
            "p": ca.vertcat(ca.vec(U), ca.vec(Y), x_prev, p_prev),
            "f": cost / 2,
            "g": ca.vertcat(*equal),
        }
        options = {**QUIET, "ipopt.warm_start_init_point": "yes", "ipopt.nlp_scaling_method": "none", "ipopt.mumps_pivot_order": 0}
        self.solver = ca.nlpsol("plain", "ipopt", program, options)
        self.each, self.np, self.nx, self.nw = nx * (1 + self.inner) + nw, np_, nx, nw
        first, guess = case.start() / case.arrival_x, case.guess / case.arrival_p
        self.v = np.concatenate([np.tile(np.concatenate([first] * (1 + self.inner) + [np.zeros(nw)]), WINDOW), first, guess])
        self.multipliers = np.zeros(self.solver.size1_in("lbg"))
        self.prior, self.failed, self.iterations = (first, guess), 0, 0

    def step(self, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """x, p after sample k; nothing before the window is full."""
        if k < WINDOW:
            return None
        case, rows, e = self.case, slice(k - WINDOW, k + 1), self.each
        given = np.concatenate([case.inputs[rows].ravel(), case.outputs[rows].ravel(), *self.prior])
        found = self.solver(x0=self.v, p=given, lam_g0=self.multipliers, lbg=0, ubg=0)
        v, lam = found["x"].full().ravel(), found["lam_g"].full().ravel()
        stats = self.solver.stats()
        self.failed += not stats["success"]
        self.iterations += stats["iter_count"]
        m = len(lam) // WINDOW
        self.multipliers = np.concatenate([lam[m:], lam[-m:]])
        x, p = v[WINDOW * e : WINDOW * e + self.nx], v[-self.np :]
        self.prior = v[e : e + self.nx], p
        body = v[: WINDOW * e]
        self.v = np.concatenate([body[e:], x, body[-e + self.nx :], x, p])
        return x * self.case.arrival_x, p * self.case.arrival_p


class DoMpc:
    """do-mpc's MHE class with the settings of its examples: Radau 2, its own warm start, Ipopt's output off.

    Its readings are those at the end of an interval and see that interval's input: readings that see the input at once are told the next
    one beside it. They see no residual force.
    """

    name = "do-mpc"

    def __init__(self, case: Case) -> None:
        import do_mpc

        self.case, nu, ny = case, case.inputs.shape[1], case.outputs.shape[1]
        model = do_mpc.model.Model("continuous")
        x = ca.vertcat(*(model.set_variable("_x", f"x{i}") for i in range(len(case.states))))
        p = ca.vertcat(*(model.set_variable("_p", f"p{i}") for i in range(len(case.guesses))))
        u = ca.vertcat(*(model.set_variable("_u", f"u{i}") for i in range(nu)))
        self.at_once = len(case.prompt) < ny
        ahead = ca.vertcat(*(model.set_variable("_u", f"ahead{i}") for i in range(nu))) if self.at_once else u
        nw = len(case.places)
        nothing = ca.SX(nw, 1)
        rates, per_force = case.rates(x, u, p, nothing), ca.SX.sym("w", nw)
        # a force acts on the accelerations: do-mpc adds a noise to each rate, so their deviations are what the forces' make of them
        noisy = len(case.states) // 2
        slope = ca.Function("slope", [x, u, p], [ca.jacobian(case.rates(x, u, p, per_force), per_force)])
        self.spread = np.array(slope(case.start(), np.zeros(nu), case.true_parameters))[noisy:] * (case.force_std / np.sqrt(case.step))
        for i in range(len(case.states)):
            model.set_rhs(f"x{i}", rates[i], process_noise=i >= noisy)
        y = case.readings(x, ahead, p, nothing)
        for i in range(ny):
            model.set_meas(f"y{i}", y[i], meas_noise=True)
        for i in range(nu):
            model.set_meas(f"u{i}", u[i], meas_noise=False)
            if self.at_once:
                model.set_meas(f"ahead{i}", ahead[i], meas_noise=False)
        model.setup()
        self.mhe = mhe = do_mpc.estimator.MHE(model, [f"p{i}" for i in range(len(case.guesses))])
        mhe.settings.n_horizon, mhe.settings.t_step = WINDOW, case.step
        mhe.settings.meas_from_data, mhe.settings.store_full_solution = True, False
        mhe.settings.nlpsol_opts = QUIET
        mhe.set_default_objective(
            P_x=np.diag(case.arrival_x**-2.0),
            P_v=np.diag(case.noise_std**-2.0),
            P_p=np.diag(case.arrival_p**-2.0),
            P_w=np.linalg.inv(self.spread @ self.spread.T),
        )
        template = mhe.get_p_template()
        mhe.set_p_fun(lambda _: template)
        mhe.setup()
        mhe.x0, mhe.p_est0 = case.start(), case.guess
        mhe.set_initial_guess()
        self.failed, self.iterations = 0, 0

    def step(self, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """x, p after sample k."""
        if k == 0:
            return None
        case = self.case
        # the model's measured quantities stand in the order in which they were set
        pairs = zip(case.inputs[k - 1], case.inputs[k], strict=True)
        mixed = [pair if self.at_once else pair[:1] for pair in pairs]
        y = np.concatenate([case.outputs[k], *mixed])
        x = self.mhe.make_step(y[:, None]).ravel()
        self.failed += not self.mhe.solver_stats["success"]
        self.iterations += self.mhe.solver_stats["iter_count"]
        return x, np.array(self.mhe.opt_x_num["_p_est"]).ravel()
