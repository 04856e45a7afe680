"""How well an explanation fits: the errors that it leaves, in all and in each half of the evidence,
where it has the parameters that fit the other half.
"""

from dataclasses import dataclass

import numpy as np

#: An explanation leaves at most this share of an error ...
WORTH_SHARE = 0.5
#: ... and at most this share in each half.
HALF_SHARE = 0.9
#: Each fitted parameter has to reduce the product of the errors by this share.
PRICE = 0.2
#: Two mistakes at once leave at most these shares of what one may leave of lengths, and of an
#: error of turns with which nothing is explained.
_HALF = 0.5
_LITTLE = 0.2
_NEVER = 1e6
#: Of samples with an error each, at least this share has a smaller one.
_MOST = 0.8


@dataclass(frozen=True, eq=False)
class Limits:
    """(k,) each, of k kinds of errors. rounding: smaller errors are none. worth: a larger error is
    worth an explanation; largest: what an explanation may leave of it. bearable: with a larger
    error nothing is explained.
    """

    rounding: np.ndarray
    worth: np.ndarray
    largest: np.ndarray
    bearable: np.ndarray

    @property
    def failed(self) -> np.ndarray:
        """The errors of what cannot be compared: as those of an estimate that fails."""
        return np.where(np.isfinite(self.worth), self.largest, _NEVER)


@dataclass(frozen=True, eq=False)
class Fit:
    """Errors as given and as explained (3, k): in all, and in each half, where the explanation has
    the parameters that fit the other half.
    """

    given: np.ndarray
    found: np.ndarray
    limits: Limits

    def cost(self, parameters: int) -> float:
        """Mean logarithm of the product of the errors of each half, and the price of the fitted
        parameters.
        """
        return self._product(self.found) + PRICE * parameters

    def pays(self, parameters: int) -> bool:
        """Whether the cost is less than with nothing explained."""
        return self.cost(parameters) < self._product(self.given)

    def _product(self, errors: np.ndarray) -> float:
        return float(np.log(np.maximum(errors[1:], self.limits.rounding)).sum() / 2)

    def explains(self, concerns_all: bool = False) -> bool:
        """Whether it halves an error and makes none of the others clearly worse; or makes all
        others of lengths clearly smaller, if it concerns them all.
        """
        left = self._left(self.given)[0]
        is_length = np.isfinite(self.limits.worth)
        most = np.where(is_length & concerns_all, HALF_SHARE, 1 / HALF_SHARE)
        if (self.found[0] > self.limits.bearable).any() or (left > most).any():
            return False
        fits = self.found[0] <= np.minimum(WORTH_SHARE * self.given[0], self.limits.largest)
        holds = (self.found[1:] <= HALF_SHARE * self.given[1:]).all(0)
        return bool((fits & holds & (self.given[0] > self.limits.worth)).any())

    def halves_errors_of(self, other: "Fit") -> bool:
        """Whether it leaves at most half of an error that another explanation leaves, and less."""
        least = np.maximum(other.found[0], self.limits.rounding)
        is_less = self.found[0] < other.found[0]
        return bool((is_less & (self.found[0] <= WORTH_SHARE * least)).any())

    @property
    def is_close(self) -> bool:
        """Whether it leaves clearly less than an explanation may."""
        is_length = np.isfinite(self.limits.worth)
        most = np.where(is_length, _HALF * self.limits.largest, _LITTLE * self.limits.bearable)
        return bool((self.found[0] <= most).all())

    def _left(self, of: np.ndarray) -> np.ndarray:
        """The share of errors that is left."""
        return (self.found + self.limits.rounding) / (of + self.limits.rounding)


def is_explained(given: np.ndarray, found: np.ndarray) -> bool:
    """Whether the errors (n,) of samples as given are explained by what leaves the errors `found`
    (n,) of the same samples: in all of them, in each half, and of most.
    """
    if len(given) < 2 or np.mean(found < given) < _MOST:
        return False
    parts = slice(None), slice(None, None, 2), slice(1, None, 2)
    means = [np.array([[errors[part].mean()] for part in parts]) for errors in (given, found)]
    none, any_size = np.zeros(1), np.full(1, np.inf)
    return Fit(means[0], means[1], Limits(none, none, any_size, any_size)).explains()
