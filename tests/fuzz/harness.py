# SPDX-License-Identifier: Apache-2.0
"""What the fuzzers' programs share: their options, how long they go on, and what is told at the end."""

import time
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple


class Finding(NamedTuple):
    """What did not end well."""

    case: int  # its number, which makes it again with the seed
    sent: str  # what was given, in short
    said: str  # what is wrong


def options(about: str | None, seconds: float = 60.0, **numbers: tuple[int | None, str]) -> Namespace:
    """Of a program's command line: `--seed`, `--seconds`, and whole numbers by name, each with its default and help."""
    parser = ArgumentParser(description=about, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=seconds, help="how long")
    parser.add_argument("--seed", type=int, default=1)
    for name, (default, said) in numbers.items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=int, default=default, help=said)
    return parser.parse_args()


def tell(cases: Iterable[tuple[str, Finding | None]], asked: Namespace, what: str) -> int:
    """Go on for `asked.seconds` or `asked.count` cases, told by kind, and print findings; status 1 where there is any."""
    counts: Counter[str] = Counter()
    findings, until = 0, time.monotonic() + asked.seconds
    for kind, finding in cases:
        counts[kind] += 1
        if finding is not None:
            findings += 1
            print(f"seed {asked.seed}, case {finding.case}: {finding.said}\n  {finding.sent}", flush=True)
        if counts.total() >= asked.count or time.monotonic() > until:
            break
    told = ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items()))
    print(f"{counts.total()} {what} ({told}): {findings} findings")
    return 1 if findings else 0
