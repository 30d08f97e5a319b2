"""Problems for benchmarks: streams along motions of shipped robots."""
