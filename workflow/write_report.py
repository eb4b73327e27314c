"""`make report`: Snakemake's report of the study, in which large results open in every browser, too."""

import subprocess
import sys
from pathlib import Path

from unilateral.system.files import replacing

PARTS = Path(__file__).parent / "report"


def main(target):
    """Write the report, with the script that opens large results."""
    with replacing(target) as report:
        options = ["--report", report, "--report-stylesheet", PARTS / "style.css"]
        process = subprocess.run(
            [sys.executable, "-m", "snakemake", *options], stderr=subprocess.PIPE, text=True
        )
        if process.returncode:
            print(process.stderr, end="", file=sys.stderr)
            sys.exit(process.returncode)
        head, body, tail = report.read_text(encoding="utf-8").rpartition("</body>")
        script = f"<script>\n{(PARTS / 'large.js').read_text(encoding='utf-8')}</script>\n"
        report.write_text(head + script + body + tail, encoding="utf-8")
    print(f"The report is in {target}; open it in a browser.")


if __name__ == "__main__":
    main(sys.argv[1])
