"""All figures in git, drawn from their tables by a process of its own, into the current folder.

`python redraw.py` prints what is wrong with their pages, by their names, as JSON.
"""

import json
import sys
from pathlib import Path

from matplotlib import rc_context
from pages import FIGURES, ROOT, faults, module_of, record_figures

ODD = {"lines.linewidth": 9, "axes.facecolor": "red", "svg.hashsalt": None, "savefig.bbox": "tight"}
"""Settings that a user may have."""


def main():
    computed = {}
    for name in FIGURES:
        draw = module_of(name).draw
        with rc_context(ODD), record_figures() as pages:
            draw(ROOT / f"figures/{name}.csv", Path(f"{name}.svg"))
        computed[name] = faults(pages[0])
    assert "matplotlib.pyplot" not in sys.modules  # which has windows
    print(json.dumps(computed))


if __name__ == "__main__":
    main()
