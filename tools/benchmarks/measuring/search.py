"""Finds the fewest samples that reach an error.

Errors fall with the number of samples, apart from a little noise, so a ladder of counts is climbed or descended until
the error crosses the aim. Steps are at most a half (mostly a third): times are overstated by less than that, equally
for every method.
"""

# Over this many steps up the ladder the number of samples quadruples and errors should halve. Where they fall by less
# than this share, bias dominates, and more samples would not help.
FLOOR_STEPS, FLOOR_SHARE = 4, 0.1

LADDER = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, 1536, 2048, 3072, 4096]


def fewest(error_of, aim, start):
    """The smallest count of LADDER with an error of at most `aim`, searched from `start`; and all errors measured.

    Returns (None, errors) if none reaches it, or if the error levels off above the aim.
    """
    errors = {}

    def reaches(i):
        errors[LADDER[i]] = error_of(LADDER[i])
        return errors[LADDER[i]] <= aim

    i = LADDER.index(start)
    if reaches(i):
        while i > 0 and reaches(i - 1):
            i -= 1
        return LADDER[i], errors
    while i + 1 < len(LADDER):
        i += 1
        if reaches(i):
            return LADDER[i], errors
        before = errors.get(LADDER[i - FLOOR_STEPS]) if i >= FLOOR_STEPS else None
        if before is not None and errors[LADDER[i]] > (1.0 - FLOOR_SHARE) * before:
            break
    return None, errors


def staircase(measure, aim, most_spp, most_light_samples):
    """Searches camera and light samples together: the pairs (spp, light samples) that just reach `aim`.

    measure(spp, light_samples) returns (error, seconds). Walks from few camera and many light samples to many and few,
    and returns the pairs that reach the aim as a list of dicts, quickest first.
    """
    spps = [n for n in LADDER if n <= most_spp]
    lights = [n for n in LADDER if n <= most_light_samples]
    reached = []
    s, m = 0, len(lights) - 1
    while s < len(spps) and m >= 0:
        error, seconds = measure(spps[s], lights[m])
        if error <= aim:
            reached.append({"spp": spps[s], "light_samples": lights[m], "rmse": error, "seconds": seconds})
            m -= 1
        else:
            s += 1
    return sorted(reached, key=lambda r: r["seconds"])
