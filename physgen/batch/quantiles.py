"""A share in 0..1 -> the value below which that share of a distribution lies; the same bits on every machine.

Logarithms and exponentials of the C library differ between machines in their last bit; those of `decimal` are rounded
correctly, and so are +, -, *, / and square roots of floats.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Context, Decimal
from functools import cache
from math import inf, sqrt

FINE = Context(prec=28)
WRITTEN = Context(prec=15)
"""Digits that a float keeps: what lies between is the same float."""

# Wichura, M. J. (1988), Algorithm AS 241: The percentage points of the normal distribution, Applied Statistics 37 (3),
# 477-484, PPND16: ratios of polynomials, lowest power first
_MIDDLE = (
    (3.3871328727963666080e0, 1.3314166789178437745e2, 1.9715909503065514427e3, 1.3731693765509461125e4,
     4.5921953931549871457e4, 6.7265770927008700853e4, 3.3430575583588128105e4, 2.5090809287301226727e3),
    (1.0, 4.2313330701600911252e1, 6.8718700749205790830e2, 5.3941960214247511077e3,
     2.1213794301586595867e4, 3.9307895800092710610e4, 2.8729085735721942674e4, 5.2264952788528545610e3),
)  # fmt: skip
_FLANK = (
    (1.42343711074968357734e0, 4.63033784615654529590e0, 5.76949722146069140550e0, 3.64784832476320460504e0,
     1.27045825245236838258e0, 2.41780725177450611770e-1, 2.27238449892691845833e-2, 7.74545014278341407640e-4),
    (1.0, 2.05319162663775882187e0, 1.67638483018380384940e0, 6.89767334985100004550e-1,
     1.48103976427480074590e-1, 1.51986665636164571966e-2, 5.47593808499534494600e-4, 1.05075007164441684324e-9),
)  # fmt: skip
_TAIL = (
    (6.65790464350110377720e0, 5.46378491116411436990e0, 1.78482653991729133580e0, 2.96560571828504891230e-1,
     2.65321895265761230930e-2, 1.24266094738807843860e-3, 2.71155556874348757815e-5, 2.01033439929228813265e-7),
    (1.0, 5.99832206555887937690e-1, 1.36929880922735805310e-1, 1.48753612908506148525e-2,
     7.86869131145613259100e-4, 1.84631831751005468180e-5, 1.42151175831644588870e-7, 2.04426310338993978564e-15),
)  # fmt: skip


def normal(share: float) -> float:
    """Of the normal distribution of mean 0 and standard deviation 1, to 16 digits; 0 < share < 1."""
    off = share - 0.5
    if abs(off) <= 0.425:
        square = 0.180625 - off * off
        return off * _horner(_MIDDLE[0], square) / _horner(_MIDDLE[1], square)
    far = sqrt(float(-FINE.ln(Decimal(share if off < 0 else 1.0 - share))))
    above, below = (_FLANK, far - 1.6) if far <= 5.0 else (_TAIL, far - 5.0)
    value = _horner(above[0], below) / _horner(above[1], below)
    return value if off > 0 else -value


def below(value: float) -> Decimal:
    """The share of the normal distribution of mean 0 and standard deviation 1 that lies below `value`, to 25 digits.

    As exact in the lower tail, however small it is: 1/2 + phi(x) (x + x^3/3 + x^5/15 + ...), a series of one sign.
    """
    if value in (inf, -inf):
        return Decimal(int(value > 0))
    x = Decimal(value)
    context = Context(prec=40 + int(x * x / 4))  # what cancels in the tail, exp(-x^2 / 2), is carried along
    square = context.multiply(x, x)
    term = total = x
    count = 1
    while abs(term) > abs(total) * Decimal(10) ** -context.prec:
        count += 2
        term = context.divide(context.multiply(term, square), Decimal(count))
        total = context.add(total, term)
    root = context.sqrt(context.multiply(Decimal(2), _pi(context)))
    density = context.divide(context.exp(context.divide(square, Decimal(-2))), root)
    return FINE.plus(context.fma(density, total, Decimal("0.5")))


def _pi(context: Context) -> Decimal:
    """By Machin (1706): 16 arctan(1/5) - 4 arctan(1/239)."""

    def arctan(whole: int) -> Decimal:
        power = total = context.divide(Decimal(1), Decimal(whole))
        count = 1
        while abs(power) > Decimal(10) ** -context.prec:
            power = context.divide(power, Decimal(-whole * whole))
            count += 2
            total = context.add(total, context.divide(power, Decimal(count)))
        return total

    return context.subtract(
        context.multiply(Decimal(16), arctan(5)), context.multiply(Decimal(4), arctan(239))
    )


def between(low: float, high: float, share: Decimal) -> float:
    """Of the distribution from `low` to `high`, of one sign, whose logarithm is uniform; the share may be exact."""
    sign = 1 if low > 0 else -1
    begin, end = _ln(abs(low)), _ln(abs(high))
    power = FINE.add(begin, FINE.multiply(share, FINE.subtract(end, begin)))
    return sign * float(WRITTEN.plus(FINE.exp(power)))


@cache
def _ln(value: float) -> Decimal:
    return FINE.ln(Decimal(value))


def _horner(coefficients: Sequence[float], x: float) -> float:
    total = 0.0
    for coefficient in reversed(coefficients):
        total = total * x + coefficient
    return total
