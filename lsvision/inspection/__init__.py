"""Jobs and verdicts: limits, guard band, relations, statistics of many parts."""
