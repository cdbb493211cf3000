"""Samples that a recorder loses again and again are said with their seconds."""

import numpy as np
import pytest

from hand_made_logs import channel, flight_log, hover_thrust, motion_log, prepared
from rotorfit.flight.many_gaps import GAPS


def with_gaps(log, every, lost):
    """Return the log, by a clock that runs already, without `lost` seconds of every `every`."""
    return flight_log(
        **{
            name: channel(one.time[kept] + 700.0, one.values[kept])
            for name, one in log.channels.items()
            for kept in [one.time % every >= lost]
        }
    )


@pytest.mark.parametrize(("every", "gaps"), [(2.3, 13), (15.0, 0)])
def test_gaps_that_cut_a_flight_are_said(every, gaps):
    log = with_gaps(motion_log(hover_thrust(30.0)), every, 0.192)
    said = [one for one in prepared(log).findings if one.kind == GAPS]
    assert [one.evidence[0].value for one in said] == ([gaps] if gaps else [])
    for one in said:
        assert "of 0.2 s each" in one.sentence
        assert np.char.count(one.sentence, "pieces of up to 2.1 s") == 1
        assert "first at 1.2 s" in one.sentence
