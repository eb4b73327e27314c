"""The page for users of scikit-fem: both codes agree as far as their discretisations do."""

import contextlib
import io
from itertools import pairwise

import numpy as np
from documents import blocks


def solve_page_programs(refined, f="(3 * w.x[0] - 2)"):
    """What the page's programs find on a mesh refined so often, with cells of two edges, for that f there."""
    programs = [
        block.text for block in blocks("docs/coming-from.md") if block.kind == "python" and not block.reason
    ]
    text = (
        "\n".join(programs)
        .replace("refined(5)", f"refined({refined})")
        .replace("H=1 / 16", f"H=2 / 2**{refined}")
    )
    names = {"__name__": "__main__"}
    with contextlib.redirect_stdout(io.StringIO()):
        exec(compile(text.replace("(3 * w.x[0] - 2)", f), "coming-from.md", "exec"), names)
    return names


def measure_differences(names):
    """The distance of both in H1, and that of the forces."""
    difference = names["u"] - names["s"].u
    return np.sqrt(difference @ names["A"] @ difference), abs(names["reaction"].sum() - names["force"].value)


def test_both_programs_agree_up_to_the_error_of_the_discretisation():
    """||u - u_h||_1 is O(h) for both, so their distance is; the forces' errors are at most of that order.

    Control: with another load they do not agree.
    """
    distances = []
    for refined in (4, 5, 6):
        names = solve_page_programs(refined)
        bound = names["s"].bounds.u
        force = names["force"]
        distance, forces = measure_differences(names)
        assert distance <= 2 * bound
        assert force.lower <= names["reaction"].sum() <= force.upper
        assert forces <= force.upper - force.lower
        distances.append(distance)
        np.testing.assert_allclose(names["arrays"].u, names["s"].u, rtol=0, atol=1e-2 * bound)
    assert all(fine <= 0.6 * coarse for coarse, fine in pairwise(distances))
    other_solution = solve_page_programs(5, "(3 * w.x[0] - 1)")
    assert measure_differences(other_solution)[0] > 2 * other_solution["s"].bounds.u
    assert (
        not other_solution["force"].lower <= other_solution["reaction"].sum() <= other_solution["force"].upper
    )
