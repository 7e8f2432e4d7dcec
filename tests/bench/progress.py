"""Progress of a long loop, on stderr: the numbers on stdout stay clean."""

import sys


def counted(items, what):
    """The items one by one, with a line that counts them; five lines where no one watches."""
    items, live = list(items), sys.stderr.isatty()
    step = max(1, len(items) // (50 if live else 5))
    for done, item in enumerate(items):
        if done % step == 0:
            start, end = ("\r", "") if live else ("", "\n")
            print(f"{start}  {what} {done}/{len(items)} ", end=end, file=sys.stderr, flush=True)
        yield item
    if live:
        print(f"\r{' ' * (len(what) + 24)}\r", end="", file=sys.stderr, flush=True)
