"""The paper's scaling argument in symbols: what its steps give, and which slips give its root.

    python -m tests.derivation

prints the derivation.  That a slip gives the printed root does not say that it occurred.
"""

from __future__ import annotations

from sympy import Eq, Expr, Matrix, cos, pi, pretty, simplify, solve, sqrt, symbols

n, m, a, F_g, F, mu, R = symbols("n m a F_g F mu R", positive=True)
N = symbols("N", real=True)

PRINTED = sqrt(2 * F_g / (m * a))  # eq. (6)


def norm(vector: Matrix) -> Expr:
    """Euclidean norm."""
    return simplify(sqrt(vector.dot(vector)))


TILES = n**2 * m * a  # norm of F_nt, eq. (3)
PRINTED_GLUE = 2 * n * F_g * sqrt(2) / 2 * Matrix([1, 1])  # eq. (4)
GLUE = -n * F_g * Matrix([1, 1])  # n bonds along -x, n along -y


def bound(glue: Expr, tiles: Expr = TILES) -> Expr:
    """The n at which the norms of glue and tile force are equal, eq. (5)."""
    (found,) = solve(Eq(glue, tiles), n)
    return simplify(found)


def printed_steps() -> Expr:
    """The bound that follows from eqs. (3), (4) and (5)."""
    return bound(norm(PRINTED_GLUE))


def slips() -> dict[str, Expr]:
    """Single slips after which eq. (6) is as printed."""
    root = symbols("s", positive=True)  # sqrt(n)
    (of_root,) = solve(Eq(norm(PRINTED_GLUE).subs(n, root**2), TILES.subs(n, root**2)), root)
    return {
        "n lost in the norm of F_ng": bound(norm(PRINTED_GLUE) / n),
        "sqrt(n) read as n": simplify(of_root),
    }


def slipping_load() -> Expr:
    """Load per tile at which a block begins to slide along +x.

    The lower wall presses with N and rubs with mu N, the floor with R a tile against the motion;
    the left wall has let go.
    """
    along = Eq(n**2 * F, n * F_g + mu * N + n**2 * R)
    across = Eq(N, n * F_g)  # nothing pulls along y
    (found,) = solve([along, across], [F, N], dict=True)
    return simplify(found[F])


def readings() -> dict[str, Expr]:
    """Bound on n of every reading; F = m a is the load per tile, R the floor's friction."""
    g = F_g / n
    # The resultant of load, glue and floor must stay within the walls' reach, of which the
    # outermost line has its normal at atan(mu); see theory.scaling.critical_load.
    cosine = 1 / sqrt(1 + mu**2)
    sine = mu * cosine
    line = g * (cosine + sine) + R

    size_n = symbols("n")  # its sign is not known before F - R is

    def size(load: Expr) -> Expr:
        (found,) = solve(Eq(F, load.subs(n, size_n)), size_n)
        return simplify(found)

    return {
        "printed norms": printed_steps().subs(m, F / a),
        "vector sum": bound(norm(GLUE)).subs(m, F / a),
        "diagonal": size(g / cos(pi / 4)),  # each component of F equals g
        "quadrant": size(g),  # one component has all of F
        "tile friction, axis": size(line.subs(R, 0) / cosine),
        "tile friction, rotating": size(line.subs(R, 0)),
        "floor friction, axis, slip": size(slipping_load()),
        "floor friction, axis, rest": size(line / cosine),
        "floor friction, rotating, rest": size(line),
        "floor friction, diagonal": size(g / cos(pi / 4) + R),
    }


def main() -> None:
    """Print the derivation."""
    def show(text: str, formula: Expr) -> None:
        print(f"{text}:\n\n{pretty(formula)}\n")

    print("The paper's eqs. (3) to (6), n tiles to a side, F_g a glue, m a the load of a tile.\n")
    show("Norm of F_nt, eq. (3)", TILES)
    show("Norm of F_ng as printed, eq. (4)", norm(PRINTED_GLUE))
    show("Eq. (5) with these norms bounds n by", printed_steps())
    show("and sqrt(n) by", simplify(sqrt(printed_steps())))
    show("Eq. (6) as printed bounds n by", PRINTED)
    print("Single slips that would give it (not that they occurred):\n")
    for name, formula in slips().items():
        show(name, formula)
    show("The glues pull along -x and -y: norm of their sum", norm(GLUE))
    print("Bounds on n, F = m a the load, R the floor's friction on a tile:\n")
    for name, formula in readings().items():
        show(name, formula)


if __name__ == "__main__":
    main()
