"""Interleaved repeated measurements, and their summaries."""

import statistics


def summary(values):
    """Median and spread of repeated measurements."""
    values = list(values)
    return {"median": statistics.median(values), "least": min(values), "most": max(values), "values": values}


def in_turn(jobs, repeats):
    """Runs the jobs A B C A B C ...: returns {name: [result of each repeat]}.

    Interleaved, because a machine's speed drifts: the drift then affects all jobs alike.
    """
    results = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            results[name].append(job())
    return results


def ratio(above, below):
    """Ratio of two summaries' medians, with the ratios of single repeats as its spread."""
    return {"value": above["median"] / below["median"],
            "repeats": [a / b for a, b in zip(above["values"], below["values"])]}
