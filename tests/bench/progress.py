"""Progress of a long loop, on stderr, so that stdout has the results only."""

import sys


def counted(items, what):
    """Yield the items and print how many are done: in one line of a terminal, else in five."""
    items, on_terminal = list(items), sys.stderr.isatty()
    step = max(1, len(items) // (50 if on_terminal else 5))
    for done, item in enumerate(items):
        if done % step == 0:
            start, end = ("\r", "") if on_terminal else ("", "\n")
            print(f"{start}  {what} {done}/{len(items)} ", end=end, file=sys.stderr, flush=True)
        yield item
    if on_terminal:
        print(f"\r{' ' * (len(what) + 24)}\r", end="", file=sys.stderr, flush=True)
