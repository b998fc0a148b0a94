"""The rows by number and name."""

import dataclasses

from . import (rows_error, rows_frame, rows_glossy, rows_lookup, rows_occlusion, rows_peer, rows_quality, rows_target,
               rows_whole)


@dataclasses.dataclass(frozen=True)
class Row:
    number: int
    name: str
    measure: object  # Context -> RowResult; its docstring is the row's title

    def title(self):
        return self.measure.__doc__.strip()


ROWS = [
    Row(0, "ceiling", rows_frame.ceiling),
    Row(1, "lookups", rows_lookup.lookups),
    Row(2, "lookup-size", rows_lookup.size),
    Row(3, "secondary-warm", rows_error.warm),
    Row(4, "secondary-cold", rows_error.cold),
    Row(5, "wide-light", rows_error.wide_light),
    Row(6, "closeup", rows_error.closeup),
    Row(7, "baseline", rows_peer.baseline),
    Row(8, "three-objects", rows_peer.three_objects),
    Row(9, "crowd", rows_peer.crowd),
    Row(10, "converged", rows_quality.converged),
    Row(11, "check", rows_quality.check),
    Row(12, "cells", rows_quality.cells),
    Row(13, "second-light", rows_frame.second_light),
    Row(14, "threads", rows_frame.threads),
    Row(15, "glossy", rows_glossy.glossy),
    Row(16, "glossy-converged", rows_glossy.glossy_converged),
    Row(17, "reflection", rows_glossy.reflection),
    Row(18, "whole-lights", rows_whole.lights),
    Row(19, "whole-skies", rows_whole.skies),
    Row(20, "targets", rows_target.targets),
    Row(21, "occlusion", rows_occlusion.occlusion),
]


def choose(words):
    """Rows by name or number, in table order; all if no words are given. Raises KeyError for an unknown word."""
    if not words:
        return list(ROWS)
    known = {**{row.name: row for row in ROWS}, **{str(row.number): row for row in ROWS}}
    wanted = {known[word].name for word in words}
    return [row for row in ROWS if row.name in wanted]
