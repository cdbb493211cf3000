"""State which channels stand off their neighbours for single samples, which are replaced."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rotorfit.findings import Evidence, Finding, doubt

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from rotorfit.flight.clocks import UniformChannels

REPLACED: Final = "replaced-samples"
"""Kind of the finding that many samples of a channel were replaced."""
LEAST_SHARE: Final = 0.01
"""Share of replaced samples from which it is said: sound logs have up to .0013."""
LEAST_RATE: Final = 50.0
"""Rate of a channel [Hz] from which it is said: of slower ones quick turns last a sample or two."""
_CHANNELS: Final = {
    "gyro": "gyro's values",
    "accel": "accelerometer's values",
    "motor": "rotor speeds",
}


def replaced_samples(spikes: Mapping[str, int], uniform: UniformChannels) -> Iterator[Finding]:
    """Yield a doubt for each channel of which many samples were replaced.

    `spikes`: number of replaced samples, by channel.
    """
    seconds = len(uniform.time) / uniform.sample_rate
    for name, count in spikes.items():
        share = count / (seconds * uniform.rates[name])
        if share < LEAST_SHARE or uniform.rates[name] < LEAST_RATE:
            continue
        words = _CHANNELS[name]
        yield doubt(
            REPLACED,
            f"in {100.0 * share:.2g} % of the rows the {words} stand far off their neighbours: "
            "these samples are taken from them; see why the sensor or the recorder loses some",
            evidence=(Evidence(name=f"replaced_{name}", value=share, limit=LEAST_SHARE),),
        )
