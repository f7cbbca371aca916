"""Fly the golden runs anew, on purpose, and say what changed: ``python tests/recordings/renew.py``.

For each it says what the code of today makes of the recording as it is (as the tests do), and replaces it by
a new flight, in which the vehicles react to the new commands. With `--check` nothing is replaced.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

from golden import GOLDEN, Golden, compare, fly


def main() -> None:
    names = [golden.name for golden in GOLDEN]
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(names)}; all without one")
    parser.add_argument("--check", action="store_true", help="say what is different, and replace nothing")
    options = parser.parse_args()
    if unknown := set(options.names) - set(names):
        parser.error(f"there is no {', '.join(sorted(unknown))}; expected {', '.join(names)}")
    for golden in GOLDEN:
        if options.names and golden.name not in options.names:
            continue
        print(f"{golden.name} ({golden.shows}):", flush=True)
        print(f"  {compare(golden.path)}" if golden.path.exists() else "  is new", flush=True)
        if not options.check:
            _renew(golden)


def _renew(golden: Golden) -> None:
    """Replace a recording by a new flight, and say how that went differently."""
    with tempfile.TemporaryDirectory() as folder:
        new = fly(golden, Path(folder))
        if golden.path.exists() and golden.path.read_bytes() == new.read_bytes():
            print("  stays as it was", flush=True)
            return
        before = compare(golden.path).outcome if golden.path.exists() else []
        result = compare(new)
        if result.first is not None:
            raise SystemExit(f"  does not replay as it was flown: {result}")
        shutil.copyfile(new, golden.path)
    print(f"  flown anew, {golden.path.stat().st_size / 1000:.0f} kB", flush=True)
    now = {what: after for what, _, after in result.outcome}
    for what, then, _ in before:
        if what in now and now[what] != then:
            print(f"    {what}: {then}  ->  {now[what]}", flush=True)


if __name__ == "__main__":
    main()
