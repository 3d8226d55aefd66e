"""One contact point in impact: Routh's process with Coulomb friction and Poisson restitution.

Wang and Mason, "Two-dimensional rigid-body collisions with friction", J. Applied Mechanics 59
(1992) 635, as a path: the impulse slides along the cone until the slip is gone, and goes on from
there by sticking or, where that would leave the cone, by sliding.
"""

from __future__ import annotations

import math
from typing import Any

from tbsa.kernels.jit import inline


@inline
def routh(vn: float, vt: float, knn: float, ktt: float, knt: float, mu: float, e: float) -> Any:
    """Impulses ``(pn, pt)`` on b of one impact (N s), pn >= 0.

    `vn`, `vt` is the velocity of b's point against a's, vn < 0 approaching; it changes by
    knn pn + knt pt and knt pn + ktt pt (knn ktt > knt^2).  `e` is the ratio of the normal
    impulses of restitution and compression.  Kinetic energy does not rise for e <= 1.
    """
    # Slopes dpt/dpn: `rest` once the slip is gone, `slide` before.
    rest = min(max(-knt / ktt, -mu), mu)
    slide, gone = rest, 0.0  # gone: normal impulse at which the slip is gone
    if vt != 0.0:
        slide, gone = -math.copysign(mu, vt), math.inf
        rate = knt + slide * ktt
        if rate * vt < 0.0:
            gone = -vt / rate
    closing = knn + knt * slide  # dvn/dpn; negative where friction presses the bodies together
    if vn > 0.0 or (vn == 0.0 and closing >= 0.0):
        return 0.0, 0.0
    if closing > 0.0 and -vn <= closing * gone:
        pn = -vn / closing
    else:
        pn = gone - (vn + closing * gone) / (knn + knt * rest)
    pn *= 1.0 + e
    if pn <= gone:
        return pn, slide * pn
    return pn, slide * gone + rest * (pn - gone)
