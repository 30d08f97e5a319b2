"""Command line of the comparison."""

from __future__ import annotations

import argparse
import resource
import shutil
import signal
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from fnmatch import fnmatchcase
from pathlib import Path

from .cases import Case, all_cases
from .difference import Difference
from .ledger import LEDGER, Entry, read_ledger
from .logs import make_logs
from .outputs import compare_folders, run_case
from .revision import HERE, Revision, checked_out, interpreter_for, runtime_directory

SHOWN = 20  # groups of intended differences of a case; unexpected ones are all printed


def main() -> int:
    """Exit code: 0 if every difference is intended, 1 otherwise."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # remove the worktree
    given = arguments()
    ledger = read_ledger(LEDGER.read_text(encoding="utf-8"))
    cases = [
        case
        for case in all_cases()
        if (case.quick or not given.quick) and fnmatchcase(case.name, given.cases)
    ]
    with checked_out(given.against) as tree, tempfile.TemporaryDirectory() as scratch:
        python = interpreter_for(tree, fresh=given.fresh_environment)
        old, new = Revision(given.against, tree, python), Revision("current", HERE, sys.executable)
        work = Path(given.keep or scratch).resolve()
        started = time.monotonic()
        pool = ThreadPoolExecutor(given.jobs)
        try:
            make_logs(cases, old, work / "logs")
            results = pool.map(lambda case: compare_case(case, old, new, work), cases)
            found = [show(case, each, ledger) for case, each in zip(cases, results, strict=True)]
        finally:
            pool.shutdown(cancel_futures=True)
            shutil.rmtree(runtime_directory(), ignore_errors=True)
    return summarise(found, ledger, len(cases), time.monotonic() - started)


def arguments() -> argparse.Namespace:
    """What the user wants."""
    parser = argparse.ArgumentParser(prog="python -m tests.frozen", description=__doc__)
    parser.add_argument("--against", required=True, metavar="REV", help="revision to compare with")
    parser.add_argument("--quick", action="store_true", help="10 pairs and a few commands")
    parser.add_argument("--cases", default="*", metavar="GLOB", help="names of the cases to run")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once (default: 2)")
    parser.add_argument("--keep", metavar="DIR", help="keep the outputs in this new folder")
    parser.add_argument(
        "--fresh-environment", action="store_true", help="install REV in an environment of its own"
    )
    return parser.parse_args()


def compare_case(case: Case, old: Revision, new: Revision, work: Path) -> list[Difference]:
    """Run a case under both revisions, one after the other."""
    folders = work / "old" / case.name, work / "new" / case.name
    for revision, folder in zip((old, new), folders, strict=True):
        run_case(case, revision, folder, work / "logs")
    return compare_folders(case, (folders[0], old.tree), (folders[1], new.tree))


def show(case: Case, found: list[Difference], ledger: list[Entry]) -> list[Entry | None]:
    """Print the differences of a case; for each the line of the ledger that covers it."""
    covering = [next((e for e in ledger if e.covers(case.name, d)), None) for d in found]
    print(f"{'different' if found else 'equal    '}  {case.name}", flush=True)
    groups: dict[tuple[str, Entry | None], list[Difference]] = {}
    for difference, entry in zip(found, covering, strict=True):
        groups.setdefault((difference.group, entry), []).append(difference)
    intended = [key for key in groups if key[1] is not None]
    for name, entry in [key for key in groups if key[1] is None] + intended[:SHOWN]:
        members = groups[name, entry]
        worst = max(members, key=lambda each: each.size or 0.0)
        more = f" and {len(members) - 1} more" if len(members) > 1 else ""
        why = f"intended: {entry.reason}" if entry else "UNEXPECTED"
        print(f"    {worst.field if len(members) == 1 else name}: {worst}{more}  [{why}]")
    if len(intended) > SHOWN:
        print(f"    and {len(intended) - SHOWN} more fields with intended differences")
    return covering


def summarise(
    found: list[list[Entry | None]], ledger: list[Entry], count: int, seconds: float
) -> int:
    """Print the totals and the lines of the ledger that matched nothing; the exit code."""
    different = sum(1 for each in found if each)
    unexpected = sum(each.count(None) for each in found)
    used = {entry for each in found for entry in each}
    for entry in ledger:
        if entry not in used:
            print(f"unused ledger line {entry.line}: {entry.case} | {entry.field} | {entry.change}")
    used_cpu = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{count} cases in {seconds:.0f} s ({used_cpu.ru_utime + used_cpu.ru_stime:.0f} s of CPU): "
        f"{count - different} equal, {different} different; "
        f"{sum(map(len, found)) - unexpected} differences intended, {unexpected} unexpected"
    )
    return 1 if unexpected else 0


if __name__ == "__main__":
    sys.exit(main())
