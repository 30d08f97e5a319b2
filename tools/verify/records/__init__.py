"""Events, log times, sessions and summaries of a log, against its ticks and a replay."""
