"""Every term of an interval of the estimate row by row, by hand."""

from dataclasses import replace

import numpy as np
import pytest

import made_fit
from rotorfit.estimation.estimate import Estimate
from rotorfit.estimation.reweighted import BandedFit
from rotorfit.fit.intervals.numbers import Numbers
from rotorfit.fit.row_fits import (
    ROWS,
    RowFits,
    explained_ratios,
    number_scale,
    row_excitation,
    row_numbers,
    turn_ratios,
)
from rotorfit.model.regressor import regressor

MASS, KT = 1.4, 2e-6
VALUES = {
    "force": {"kt": KT, "msx": 0.0, "msy": 0.0, "msz": 0.0, "Fx_0": 0.0, "Fy_0": 0.0, "Fz_0": 0.0},
    "roll": {"kt": KT / 0.01, "Ixy": 0.0, "Ixz": 0.0},
    "pitch": {"kt": KT / 0.0225, "Ixy": 0.0, "Iyz": 0.0},
    "yaw": {"kd": 1.5e-6, "Jr": 1e-3},
}
RHO = {"roll": 22.5, "pitch": 7.5, "yaw": 16.5}
BLOCKS = 17
"""Of which the seven parameters of the force rows leave 10: t of 10 is 2.228."""


def fits(*, formal=None, scatter=None, rho=RHO):
    """Return row fits with deviations by full names; what is not named has next to none."""
    made, names = {}, []
    for row in ROWS:
        values = np.array(list(VALUES[row].values()))
        f = len(values)
        made[row] = BandedFit(
            estimate=Estimate(
                names=tuple(VALUES[row]),
                values=values,
                covariance=np.zeros((f, f)),
                condition_number=1.0,
            ),
            influence=np.zeros((BLOCKS, f)),
            variance=np.ones(BLOCKS),
            known_power=np.ones(BLOCKS),
            residual_power=np.ones(BLOCKS),
            log_likelihood=0.0,
            information=np.zeros((BLOCKS, f, f)),
        )
        names += [f"{row}.{name}" for name in VALUES[row]]
    small = {name: 1e-9 * (abs(v) or 1.0) for name, v in zip(names, _values(), strict=True)}
    std = np.array([{**small, **(formal or {})}[name] for name in names])
    spread = np.array([(scatter or {}).get(name, 0.0) for name in names])
    return RowFits(
        fits=made,
        excitation=rho,
        covariance=np.diag(spread**2),
        formal=np.diag(std**2),
        segment=np.zeros(BLOCKS, dtype=int),
    )


def _values():
    return [value for row in ROWS for value in VALUES[row].values()]


def half_width(name, *, vehicle=made_fit.QUAD, mass_std=0.0, **more):
    found = row_numbers(fits(**more), vehicle, mass=MASS, mass_std=mass_std)
    return float(found.half_width[found.index(name)])


def test_chance_is_t_times_the_wider_of_covariance_and_scatter():
    """17 blocks, of which 7 parameters leave 10: t of 10; the scatter by sqrt(17/10) more."""
    wide = 2.228 * np.sqrt(1.7) * 1e-8
    assert half_width("kt", formal={"force.kt": 1e-8}) == pytest.approx(2.228e-8, rel=1e-3)
    assert half_width("kt", scatter={"force.kt": 1e-8}) == pytest.approx(wide, rel=1e-3)
    both = {"formal": {"force.kt": 1e-8}, "scatter": {"force.kt": 1e-8}}
    assert half_width("kt", **both) == pytest.approx(wide, rel=1e-3)
    # Three parameters of 17 blocks in the roll row: 14 are left, and the fewest degrees count.
    rolled = half_width("Ixx_over_kt", scatter={"roll.kt": 1e-3 * KT / 0.01}, rho=calm(1e12))
    assert rolled == pytest.approx(2.228 * np.sqrt(17 / 14) * 1e-3 * 0.01 / KT, rel=1e-3)


def calm(rho):
    return dict.fromkeys(RHO, rho)


def test_chance_bias_and_mass_add_as_squares():
    """Ixx = 0.01 at a rho of 22.5: a tenth is 2.5 / (22.5 + 2.5), and 1 % of mass is 1.96 %."""
    unsure = {"formal": {"roll.kt": 0.05 * KT / 0.01}}
    chance = half_width("Ixx", **unsure, rho=calm(1e12))
    assert chance == pytest.approx(2.228 * 0.05 * 0.01, rel=1e-3)
    found = half_width("Ixx", **unsure, mass_std=0.014)
    assert found == pytest.approx(np.sqrt(chance**2 + 1e-3**2 + 1.96e-4**2), rel=1e-3)
    assert half_width("Iyy") == pytest.approx(0.25 * 0.0225, rel=1e-3)
    assert half_width("kt", mass_std=0.014) == pytest.approx(0.0196 * KT, rel=1e-3)
    assert half_width("com_x", mass_std=0.014) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("ratio", ["Ixx_over_kt", "Iyy_over_kt", "kd_over_Izz", "hover_speed"])
def test_a_wrong_mass_is_in_no_ratio(ratio):
    """Inertia and kt are off by the same share."""
    assert half_width(ratio, mass_std=0.14) == half_width(ratio)


def test_ratios_of_yaw_are_biased_by_1_5_over_rho():
    assert half_width("kd_over_Izz") == pytest.approx(0.1 * 1.5e-6, rel=1e-3)
    assert half_width("Jr_over_Izz") == pytest.approx(0.1 * 1e-3, rel=1e-3)


def test_a_product_near_zero_is_biased_as_one_that_matters():
    """1/20 of sqrt(0.01 * 0.0225); of Izz, as that of a flat body."""
    assert half_width("Ixy_com") == pytest.approx(0.1 * 0.015 / 20, rel=1e-3)
    assert half_width("Ixz_com") == pytest.approx(0.1 * np.sqrt(0.01 * 0.0325) / 20, rel=1e-3)
    assert half_width("Iyz_com") == pytest.approx(0.25 * np.sqrt(0.0225 * 0.0325) / 20, rel=1e-3)


def test_tilted_rotors_leave_drag_and_thrust_ambiguous():
    """Leaning by a tenth: 3 cm of drag over thrust; kd over Izz might be anything."""
    lean = (0.1, 0.0, float(np.sqrt(0.99)))
    tilted = replace(
        made_fit.QUAD, rotors=tuple(replace(r, axis=lean) for r in made_fit.QUAD.rotors)
    )
    quiet = calm(1e12)
    assert half_width("kd_over_Izz", vehicle=tilted, rho=quiet) == pytest.approx(3e-6, rel=1e-3)
    off = 0.03 * 0.1 / 0.25
    assert half_width("Ixx_com", vehicle=tilted, rho=quiet) == pytest.approx(off * 0.01, rel=1e-3)
    assert half_width("Ixx_com", rho=quiet) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "size"),
    [
        ("msx", 1.4 * 0.25 / 50),
        ("com_z", 0.25 / 50),
        ("rotor_center_y", 0.25 / 50),
        ("accel_bias_z", 0.2),
        ("Ixy_com", 4.0 / 20),
        ("Ixz", np.sqrt(20.0) / 20),
        ("Iyz_com", np.sqrt(80.0) / 20),
        ("kt", 0.0),
    ],
)
def test_sizes_that_matter_are_those_of_the_method(name, size):
    numbers = Numbers(
        names=("Ixx_com", "Iyy_com"),
        values=np.array([2.0, 8.0]),
        terms=made_fit.known_to(np.zeros(2)),
        correlation=np.eye(2),
        excitation=RHO,
    )
    assert number_scale(numbers, name, mass=1.4, arm=0.25) == pytest.approx(size)


def row_fit(known, residual):
    """Return a fit of the roll row with these powers of its blocks."""
    some, count = fits().fits["roll"], len(known)
    return replace(
        some,
        influence=some.influence[:count],
        variance=some.variance[:count],
        known_power=np.array(known),
        residual_power=np.array(residual),
        information=some.information[:count],
    )


def test_excitation_is_explained_over_residual_pilot_band_power():
    factors = made_fit.blocks([(0.0, 0.25), (0.35, 0.5), (2.0, 2.9), (3.1, 4.0)])
    made = row_fit([900.0, 15.0, 10.0, 700.0], [1.0, 2.0, 3.0, 50.0])
    assert row_excitation(made, factors) == pytest.approx(20.0 / 5.0)
    assert row_excitation(row_fit([1.0] * 4, [2.0] * 4), factors) == 0.0


def test_the_ratios_of_the_turns_are_over_all_blocks():
    powers = [([9.0, 3.0], [1.0, 2.0]), ([5.0, 5.0], [1.0, 1.0]), ([1.0], [2.0])]
    found = explained_ratios([row_fit(*each) for each in powers])
    assert found == pytest.approx([3.0, 4.0, 0.0])


def test_turns_are_explained_as_far_as_the_rotors_make_them():
    """Two blocks of the same motion: the mean of their residuals counts."""
    factors = made_fit.turned([1.0, 3.0, 2.0], [3.0, 3.0, 2.0], bands=[(1.0, 2.0), (2.0, 3.0)])
    found = turn_ratios(factors, regressor(made_fit.QUAD), mass=1.4)
    assert found == pytest.approx([1.5, 3.0, 2.0], rel=1e-6)
