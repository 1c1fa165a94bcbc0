"""The figures that the README gives, measured small: the scripts beside this file measure them in full."""

import link_silence
import numpy as np
import stop_at_loss


def test_a_stop_reaches_every_drone_at_twenty_percent_loss_within_a_tenth_of_a_second():
    taken_s = stop_at_loss.times_s(2000, 0.2, seed=3)
    assert np.isfinite(taken_s).all()
    assert np.quantile(taken_s, 0.999) <= 0.1
    assert np.median(stop_at_loss.times_s(50, 0.95, seed=3)) > 0.05  # a link that loses nearly all is another matter


def test_a_poor_link_is_not_taken_for_a_dead_drone():
    heard = link_silence.heard(1.0, 0.05, 0.02, np.random.default_rng(5))
    assert heard.silences == 0
    assert heard.stale_s < link_silence.PERSIST_S
    assert link_silence.heard(10.0, 0.05, 0.02, np.random.default_rng(5)).heartbeat_silences > 0
