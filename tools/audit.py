"""`make audit`: known vulnerabilities in the packages of requirements.txt, as pip-audit finds them in its database.

pip-audit (2.10) without a database skips every package, says "No known vulnerabilities found" and ends with 0. Here
only what was looked up counts: exit code 1 for a vulnerability, 2 where a package could not be looked up.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

REQUIREMENTS = Path(__file__).parents[1] / "requirements.txt"
VULNERABLE, UNKNOWN = 1, 2
SHOWN = 3
Run = Callable[[Sequence[str]], str]


@dataclass(frozen=True, slots=True)
class Verdict:
    """The exit code, and what is printed."""

    code: int
    text: str


def judge(report: str) -> Verdict:
    """The verdict on pip-audit's JSON; anything else is no audit."""
    try:
        packages: list[Mapping[str, Any]] = json.loads(report)["dependencies"]
    except (ValueError, KeyError, TypeError):
        return Verdict(UNKNOWN, "not audited: pip-audit gave no result; is a database reachable?")
    found = [
        f"{package['name']} {package['version']}: {vulnerability['id']}"
        f", mended in {', '.join(vulnerability.get('fix_versions', ())) or 'no version yet'}"
        for package in packages
        for vulnerability in package.get("vulns", ())
    ]
    skipped = [f"{package['name']}: {package['skip_reason']}" for package in packages if "skip_reason" in package]
    if not packages or skipped:
        head = (
            f"not audited: {len(skipped)} of {len(packages)} packages could not be looked up; nothing is known of them"
        )
        return Verdict(VULNERABLE if found else UNKNOWN, "\n".join([*found, head, *skipped[:SHOWN]]))
    return Verdict(VULNERABLE, "\n".join(found)) if found else Verdict(0, f"{len(packages)} packages: none vulnerable")


def audit(run: Run) -> Verdict:
    """Ask pip-audit of this environment about the locked packages, by their hashes; nothing is installed."""
    options = ("--requirement", str(REQUIREMENTS), "--require-hashes", "--disable-pip", "--progress-spinner", "off")
    return judge(run((sys.executable, "-m", "pip_audit", "--format", "json", *options)))


def _run(command: Sequence[str]) -> str:
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False).stdout


if __name__ == "__main__":
    verdict = audit(_run)
    print(verdict.text, file=sys.stderr if verdict.code else sys.stdout)
    sys.exit(verdict.code)
