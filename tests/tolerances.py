"""Every tolerance that several tests share, by name and with its reason."""

import math

import numpy as np

MACHINE = 1e-9  # mm, rad: noise-free geometry below a metre, in double precision
ROUNDING = 1e-12  # relative: two ways to write the same formula
CONVERGED = 1e-6  # mm, rad: where an iteration stops (1e-9 of 400 mm), with a digit to spare
DIFFERENCES = 1e-6  # relative: central differences in double precision
BRUTE_FORCE = 1e-5  # mm: Nelder-Mead and dense grids end here
PUBLISHED = 5e-5  # Gander, Golub and Strebel print four decimals
FIVE_SIGMA = 5.0  # right code fails such a comparison once in two million
FOUR_SIGMA = 4.0  # once in sixteen thousand; for scenes with a fixed seed
QUANTILE_OF_SPREAD = 4.0  # sigmas of a Monte Carlo's own error


def spread_of_rms(runs):
    """Relative error that an RMSE of so many runs may have: four sigma of 1 / sqrt(2 n)."""
    return QUANTILE_OF_SPREAD / math.sqrt(2 * runs)


def spread_of_share(share, runs):
    """Error that a share counted over so many runs may have: four sigma of the binomial."""
    return QUANTILE_OF_SPREAD * float(np.sqrt(share * (1 - share) / runs))
