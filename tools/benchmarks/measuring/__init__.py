"""The parts of tools/benchmarks/measure.py. Standard library only."""
