"""Slips in equations and units: by argument, and by what the models give."""

from collections.abc import Iterator

import numpy as np

from ema_core.description import ActuatorDescription
from ema_study.case_costs import describes, truth_and_healthy_costs
from ema_study.cases import CASES
from ema_study.errata.erratum import Erratum
from ema_study.error_forms import FORMS, HIGH_BACKLASHES, reproduction
from ema_study.models import problem
from ema_study.stop_rules import THRESHOLD


def equation_errata() -> Iterator[Erratum]:
    """Yield the slips of chapters 2 to 7 in equations, units and numbers of equations."""
    yield _time_constant()
    yield _missing_phase()
    yield from _short_circuit()
    yield _modulation()
    yield _sawtooth()
    yield _total_least_squares()
    yield _error()
    yield _true_backlash()
    yield _threshold()
    yield _time_step()
    yield Erratum(
        "Section 6.1",
        "k8 = 1 raises the gain by 150 %",
        "k8 = 1 raises it to 150 %",
        "section 4.6 and the range 0.5 to 1.5 in appendix C; k8 = 0.5 is nominal.",
    )
    yield Erratum(
        "Table 2",
        "the position-error gain has no unit",
        "1/s",
        "it makes a reference speed of an angle; section 4.6 gives it in 1/s.",
    )
    yield Erratum(
        "Eq. 4.22 and 7.1, chapter 6",
        "two equations are numbered 4.22 and two 7.1; the block of the equivalent current is said "
        "to be in figure 5.7",
        "reluctance and flux are both 4.22, error and reliability coefficient both 7.1; the block "
        "is in figure 6.1",
        "chapter 5 ends with figure 5.6.",
    )


def _time_constant() -> Erratum:
    motor = ActuatorDescription().parameters
    R_s, L_s = motor.R_s, motor.L_s
    return Erratum(
        "Table 2, eq. 3.6",
        "the time constant of the windings is R over L",
        "L over R",
        f"R over L is {R_s / L_s:.0f} 1/s, no time; L over R is {1e6 * L_s / R_s:.0f} us.",
    )


def _missing_phase() -> Erratum:
    return Erratum(
        "Eq. 3.3",
        "the back-EMF varies with the rotor angle and the phase's place, not with the direction of "
        "eccentricity",
        "the direction phi adds to the angle",
        "that direction is a fault of the reference, k7 of eq. 6.1, and appendix C sets it there; "
        "the equation, printed twice, has no place for it.",
    )


def _short_circuit() -> Iterator[Erratum]:
    yield Erratum(
        "Eq. 4.3, 4.4",
        "R_ij = R_s / (2 (N_i + N_j)), L_ij = L_s / (2 (N_i^2 + N_j^2))",
        "R_ij = R_s (N_i + N_j) / 2, L_ij = L_s (N_i^2 + N_j^2) / 2",
        "two healthy phases, N = 1, must give R_s and L_s, which are measured between phases; as "
        "printed they give a quarter.",
    )
    yield Erratum(
        "Eq. 4.5, 4.6",
        "R_i = R_s / (2 N_i), L_i = L_s / (2 N_i^2)",
        "R_i = R_s N_i / 2, L_i = L_s N_i^2 / 2",
        "nominal must give R_s / 2, and does; but half the turns, N = 0.5, have half the "
        "resistance and a quarter of the inductance (eq. 4.8, 4.9), as printed twice and four "
        "times.",
    )
    yield Erratum(
        "Section 4.4",
        "N_i is the percentage of windings in short circuit",
        "N_i is the healthy part of them",
        "N = 1 is nominal there, and appendix C sets N = 1 - k.",
    )


def _modulation() -> Erratum:
    figures = []
    for level in ("low", "high"):
        truth, healthy = truth_and_healthy_costs("thesis", f"eccentricity {level}")
        fast_truth, fast_healthy = truth_and_healthy_costs("fast", f"eccentricity {level}")
        zeta = CASES[f"eccentricity {level}"].faults["eccentricity"]
        figures.append(
            f"At zeta = {zeta:g} the true faults cost {truth:.4f} A^2.s and the healthy ones "
            f"{healthy:.4f}; with eq. 3.3 of the driven pair they cost {fast_truth:.4f} and "
            f"{fast_healthy:.4f}."
        )
    return Erratum(
        "Eq. 4.24",
        "the eccentricity modulates the one phase P times a turn, phi in one of its two terms",
        "hardly what the thesis's runs were made with; by eq. 3.3 it is one wave a turn in each "
        "phase, seen through the driven pair",
        " ".join([*figures, "The thesis's runs find eccentricity, tables 38 to 45."]),
    )


def _sawtooth() -> Erratum:
    turns = np.linspace(0.0, 1.0, 1000, endpoint=False)
    wave = 2.0 * (turns - np.floor(turns))
    return Erratum(
        "Eq. 4.25",
        "sawtooth(x) = 2 (x / 2pi - floor(x / 2pi)) replaces Matlab's",
        "less 1: Matlab's goes from -1 to 1",
        f"as printed it goes from {wave.min():.0f} to {wave.max():.0f}, mean {wave.mean():.1f}: "
        "a sine of the electrical angle is added to the modulation.",
    )


def _total_least_squares() -> Erratum:
    return Erratum(
        "Eq. 6.5, 6.6",
        "the distance is divided by the root of (dy^2/dt + 1), its square too; the derivative is "
        "said to be replaced by its root mean square",
        "(dy/dt)^2; the square of eq. 6.5 has no root; the derivative is divided by its root mean "
        "square",
        "replaced by a constant it would make a constant of the denominator, and plain least "
        "squares of the sum; divided, it has a root mean square of 1, as the text wants. We keep "
        "the root of eq. 6.6, as the thesis's appendix does not show its code.",
    )


def _error() -> Erratum:
    table = reproduction()
    followed, printed = table.loc[FORMS[0].name], table.loc[FORMS[1].name]
    column, largest = "reproduced with 0.7474", "largest deviation with 0.7474 [%]"
    return Erratum(
        "Eq. 7.1 (error)",
        "the difference of k7, squared, counts by the true k6",
        "by the square of the estimated k6",
        f"so computed, {followed[column]} of {followed['runs']} printed errors follow from the "
        f"printed estimates within rounding, the largest deviation is {followed[largest]:.3f} %; "
        f"as printed, {printed[column]} do, the largest deviation is {printed[largest]:.2f} %.",
    )


def _true_backlash() -> Erratum:
    form = reproduction().loc[FORMS[0].name]
    counts = ", ".join(f"{form[f'reproduced with {name}']} with {name}" for name in HIGH_BACKLASHES)
    return Erratum(
        "Tables 24 to 27",
        "the true backlash is 0.747",
        "0.7474: 74/99, a play of 75 times the nominal one, cut to four decimals",
        f"printed errors reproduced, of {form['runs']}: {counts}.",
    )


def _threshold() -> Erratum:
    costs = {name: problem("thesis", name).cost_at_truth for name in CASES}
    described = [cost for name, cost in costs.items() if describes("thesis", name)]
    others = {name: cost for name, cost in costs.items() if not describes("thesis", name)}
    above = sum(cost > THRESHOLD for cost in described)
    misfits = ", ".join(f"{name} {cost:.4f}" for name, cost in others.items())
    return Erratum(
        "Section 7.1",
        "cost falls to about 5e-4; 1e-3 stops the search",
        "not with our reference: the PWM ripple, which no model repeats, leaves more than that at "
        "the true faults, near which the best lies that a search can find",
        f"with the thesis's model the true faults cost {min(described):.4f} to "
        f"{max(described):.4f} A^2.s, above 1e-3 in {above} of {len(described)} cases. Left out "
        f"are those in which they cost more than the healthy ones ({misfits} A^2.s): that is the "
        "misfit of eq. 4.24, not the ripple.",
    )


def _time_step() -> Erratum:
    step, lag = 1e-6, 1e-5
    return Erratum(
        "Section 3.1",
        "the step of 1e-6 s is at least two orders below every time constant",
        "one order below the shortest",
        f"the current's filter has three lags of 1e-5 s (chapter 6), {lag / step:.0f} steps.",
    )
