"""Units of the parameters of an information matrix, whatever is left on its diagonal."""

import numpy as np

from rotorfit.estimation.banded import parameter_scale


def test_each_parameter_gets_order_one():
    information = np.diag([4.0, 1e-40, 9e30])
    scale = parameter_scale(information)
    assert np.array_equal(np.diagonal(information / np.outer(scale, scale)), [1.0, 1.0, 1.0])


def test_less_than_nothing_and_nothing_stay_finite():
    """As of a hover flight, of whose noise more was taken out than its signals have."""
    information = np.array([[4.0, 0.1, 0.0], [0.1, -1e-3, 0.0], [0.0, 0.0, 0.0]])
    scale = parameter_scale(information)
    assert np.isfinite(information / np.outer(scale, scale)).all()
    assert scale[2] == 1.0
