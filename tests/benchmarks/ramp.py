"""A load that rises slowly: the same force on every tile, (p[0], p[1]) N times a factor."""


def ramp(t, p, x, y, angle, vx, vy, omega, family, forward, fx, fy, torque):
    """The factor is p[2] + p[3] t, up to p[4]."""
    factor = min(p[2] + p[3] * t, p[4])
    for i in range(x.size):
        fx[i] += factor * p[0]
        fy[i] += factor * p[1]
