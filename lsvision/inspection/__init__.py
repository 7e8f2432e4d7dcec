"""Jobs and honest verdicts: limits, guard band, relations, statistics of many parts."""
