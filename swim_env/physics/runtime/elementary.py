"""Elementary functions without branches, so that loops over them run on vector registers.

The compiler turns a loop with ``math.log`` or ``math.atan2`` into one library call per number.
These are made of arithmetic, selects and bit casts only. The polynomials of logarithm and arc
tangent are minimax fits (relative error below 2e-18 before rounding) of ``2 atanh(s)/s`` on the
ranges that remain after the power of two is split off, and of ``atan(a)/a`` on
``|a| <= tan(pi/8)``. Sine and cosine of small angles are their power series.
"""

from __future__ import annotations

import struct

from llvmlite import ir
from numba import types
from numba.core import config as numba_config
from numba.extending import intrinsic

from swim_env.physics.runtime.compile import kernel

#: Largest angle (rad) for `sin_small` and `cos_small`: the first terms left out are below 2e-19.
SMALL_ANGLE = 0.5

_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
_PI = 3.141592653589793
_HALF_PI = 1.5707963267948966
_QUARTER_PI = 0.7853981633974483
_TAN_PI_8 = 0.41421356237309503
_TINY = 1e-300
_SQRT_HALF_BITS = 0x3FE6A09E667F3BCD
_MANTISSA_BITS = 0x000FFFFFFFFFFFFF
# An integer below 2^52 put under these exponent bits reads as 2^52 plus the integer.
_TWO_52_BITS = 0x4330000000000000
_TWO_52 = 4503599627370496.0
_HALF_EXPONENT_BITS = 1 << 51


@intrinsic
def _bits_of(typingctx, value):  # type: ignore[no-untyped-def]
    """Reinterpret a float64 as int64."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], ir.IntType(64))

    return types.int64(types.float64), codegen


@intrinsic
def _float_of(typingctx, value):  # type: ignore[no-untyped-def]
    """Reinterpret an int64 as float64."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.int64), codegen


if numba_config.DISABLE_JIT:  # debuggers and coverage run kernels as Python

    def _bits_of(value: float) -> int:  # noqa: F811
        return int(struct.unpack("<q", struct.pack("<d", value))[0])

    def _float_of(value: int) -> float:  # noqa: F811
        return float(struct.unpack("<d", struct.pack("<q", value))[0])


@kernel
def log(x: float) -> float:
    """Return the natural logarithm of a positive, normal, finite number."""
    bits = _bits_of(x)
    # Mantissa in [sqrt(1/2), sqrt(2)): the offset moves the octave's border to sqrt(1/2).
    shifted = bits - _SQRT_HALF_BITS
    exponent = (shifted >> 52) + 1023  # biased: positive for every double
    mantissa = _float_of((shifted & _MANTISSA_BITS) + _SQRT_HALF_BITS)
    power = _float_of(exponent | _TWO_52_BITS) - _TWO_52 - 1023.0
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    series = 0.14810687223102980513
    series = series * z + 0.15312428696798753645
    series = series * z + 0.18183635656993147684
    series = series * z + 0.22222196977893502942
    series = series * z + 0.28571428761443637561
    series = series * z + 0.39999999999298454703
    series = series * z + 0.66666666666667652707
    # 2 s + s^3 (...) keeps the last digits of small logarithms; ln 2 comes in two parts.
    result: float = power * _LN2_HIGH + (2.0 * s + (s * z * series + power * _LN2_LOW))
    return result


@kernel
def log_quotient(s: float, d: float) -> float:
    """Return ln((s + d)/(s - d)) of finite numbers 0 <= d < s, to its last digits where d << s.

    Where rounding has left nothing of s - d, it is taken as 1e-17 s.
    """
    numerator = s + d
    denominator = max(s - d, 1e-17 * s)
    # Without the power of two nearest to it the quotient is within a factor 2^(+-0.59) of 1.
    power = (_bits_of(numerator) - _bits_of(denominator) + _HALF_EXPONENT_BITS) >> 52
    scaled = _float_of((power + 1023) << 52) * denominator
    a = (d + d if power == 0 else numerator - scaled) / (numerator + scaled)
    z = a * a
    series = 0.13629110721861268
    series = series * z + 0.13207080082069364
    series = series * z + 0.1538900212516573
    series = series * z + 0.18181734246400322
    series = series * z + 0.2222222309164114
    series = series * z + 0.2857142856701462
    series = series * z + 0.40000000000008523
    series = series * z + 0.6666666666666666
    exponent = _float_of((power + 1023) | _TWO_52_BITS) - _TWO_52 - 1023.0
    result: float = exponent * _LN2_HIGH + (2.0 * a + (a * z * series + exponent * _LN2_LOW))
    return result


@kernel
def atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y) in (-pi, pi]; 0 at the origin.

    A zero ``y`` counts as +0 whatever its sign.
    """
    ax = abs(x)
    ay = abs(y)
    large = max(ax, ay)
    small = min(ax, ay)
    # atan(small/large) = pi/4 + atan((small - large)/(small + large)) keeps the argument small.
    fold = small > _TAN_PI_8 * large
    numerator = small - large if fold else small
    denominator = small + large if fold else large
    a = numerator / max(denominator, _TINY)
    z = a * a
    series = -0.017834179116677892156
    series = series * z + 0.037992524926269180965
    series = series * z - 0.05036218133026142907
    series = series * z + 0.058471363056614816305
    series = series * z - 0.06662988869355226983
    series = series * z + 0.076920487504070027487
    series = series * z - 0.090908970117658396851
    series = series * z + 0.11111110752412895794
    series = series * z - 0.14285714279411905924
    series = series * z + 0.19999999999942681105
    series = series * z - 0.33333333333333128896
    angle = a + a * z * series
    angle = angle + _QUARTER_PI if fold else angle
    angle = _HALF_PI - angle if ay > ax else angle
    angle = _PI - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@kernel
def sin_small(x: float) -> float:
    """Return the sine of an angle of at most SMALL_ANGLE (rad)."""
    z = x * x
    series = -1.0 / 1307674368000.0
    series = series * z + 1.0 / 6227020800.0
    series = series * z - 1.0 / 39916800.0
    series = series * z + 1.0 / 362880.0
    series = series * z - 1.0 / 5040.0
    series = series * z + 1.0 / 120.0
    series = series * z - 1.0 / 6.0
    return x + x * z * series


@kernel
def cos_small(x: float) -> float:
    """Return the cosine of an angle of at most SMALL_ANGLE (rad)."""
    z = x * x
    series = -1.0 / 87178291200.0
    series = series * z + 1.0 / 479001600.0
    series = series * z - 1.0 / 3628800.0
    series = series * z + 1.0 / 40320.0
    series = series * z - 1.0 / 720.0
    series = series * z + 1.0 / 24.0
    return 1.0 - 0.5 * z + z * z * series
