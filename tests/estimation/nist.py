"""Data sets of the NIST Statistical Reference Datasets (linear regression), certified values.

https://www.itl.nist.gov/div898/strd/lls/lls.shtml
"""

import numpy as np

# y, x. Certified: B0, B1, their standard deviations, residual standard deviation.
NORRIS = np.array(
    [
        *[(0.1, 0.2), (338.8, 337.4), (118.1, 118.2), (888.0, 884.6), (9.2, 10.1)],
        *[(228.1, 226.5), (668.5, 666.3), (998.5, 996.3), (449.1, 448.6), (778.9, 777.0)],
        *[(559.2, 558.2), (0.3, 0.4), (0.1, 0.6), (778.1, 775.5), (668.8, 666.9)],
        *[(339.3, 338.0), (448.9, 447.5), (10.8, 11.6), (557.7, 556.0), (228.3, 228.1)],
        *[(998.0, 995.8), (888.8, 887.6), (119.6, 120.2), (0.3, 0.3), (0.6, 0.3)],
        *[(557.6, 556.8), (339.3, 339.1), (888.0, 887.2), (998.5, 999.0), (778.9, 779.0)],
        *[(10.2, 11.1), (117.6, 118.3), (228.9, 229.2), (668.4, 669.1), (449.2, 448.9), (0.2, 0.5)],
    ]
)
NORRIS_VALUES = (-0.262323073774029, 1.00211681802045)
NORRIS_STD = (0.232818234301152, 0.429796848199937e-03)
NORRIS_RESIDUAL_STD = 0.884796396144373

# y, x through the origin.
NOINT1 = np.array([(130.0 + i, 60.0 + i) for i in range(11)])
NOINT1_VALUE = 2.07438016528926
NOINT1_STD = 0.165289256198347e-01

WAMPLER_X = np.arange(21.0)
# Both are exact: every coefficient is 1, or 10^-i.
WAMPLER1_Y = np.array([sum(int(x) ** i for i in range(6)) for x in range(21)], dtype=float)
WAMPLER1_VALUES = np.ones(6)
# Every y has at most five decimals, so that the printed y is the exact one.
WAMPLER2_Y = np.array([sum(x**i * 10 ** (5 - i) for i in range(6)) / 1e5 for x in range(21)])
WAMPLER2_VALUES = 10.0 ** -np.arange(6)
