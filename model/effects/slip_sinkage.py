"""How slip changes the sinkage: the published laws of a driven wheel, a braked wheel, and sinkage from a formula."""

from __future__ import annotations

from dataclasses import replace

from model.effects.base import Effect, Needs, Parameter, Values
from model.wheel_soil import Conditions, Number, SoilState


class _LawOfSlip(Effect):
    """A law of the sinkage of a driven wheel: one form of the family."""

    name = "slip_sinkage"
    own_symbols = True
    needs = Needs(largest_slip=0.15)


class Vasilev(_LawOfSlip):
    """Z = Z0 + H s for s > 0."""

    form = "vasilev"
    summary = "The wheel digs in with slip: sinkage grows by H metres from no slip to full slip, whatever the load."
    source = "Vasil'ev, Dokycheva, Utkin-Lubovtsov (1969); Yang et al. (2016), Eq. 11"
    parameters = (Parameter("H_m", "m", 0.0, 0.02, 0.0, 0.5, 0.05, "Yang Tab. 3: .02 clay, .08 sand", side=1),)

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return Eq. 11."""
        return static_sinkage + values["H_m"] * conditions.driving_slip


class Lyasko(_LawOfSlip):
    """Z = Z0 (1 + m1 s)/(1 - m2 s) for s > 0; a pole at s = 1/m2, so m2 < 1."""

    form = "lyasko"
    summary = "The wheel digs in with slip, in proportion to its static sinkage and faster at high slip."
    source = "Lyasko (2010), J. Terramechanics 47:21-31; Yang et al. (2016), Eq. 12"
    parameters = (
        Parameter(
            "m1", "1", 0.0, 0.1, -1.0, 20.0, 0.35, "Yang Tab. 3: .1 clay, .6 sand; only m1 + m2 is well known", side=1
        ),
        Parameter("m2", "1", 0.0, 0.05, 0.0, 0.95, 0.35, "Yang Tab. 3: .05 clay, .03 sand", side=1),
    )
    total = "p"

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return Eq. 12."""
        s = conditions.driving_slip
        return static_sinkage * (1.0 + values["m1"] * s) / (1.0 - values["m2"] * s)


class Ding(_LawOfSlip):
    """N = n + n1 s for s > 0, in the stress law and in whatever gives the static sinkage.

    k keeps its number: for Z < 1 m a larger exponent is a softer soil (the unit Pa/m^N holds for Z in metres).
    """

    form = "ding"
    summary = "The wheel digs in with slip because the sheared soil gets softer: the sinkage exponent grows with slip."
    source = "Ding et al. (2010), J. Cent. South Univ. Technol. 17:129-135; Yang et al. (2016), Eq. 13"
    parameters = (Parameter("n1", "1", 0.0, 0.3, 0.0, 2.0, 0.3, "Yang Tab. 3: .35 clay, .53 sand", side=1),)

    def soil(self, soil: SoilState, conditions: Conditions, values: Values) -> SoilState:
        """Return the soil with N of Eq. 13."""
        return replace(soil, exponent=soil.exponent + values["n1"] * conditions.driving_slip)


class SecondOrder(_LawOfSlip):
    """Z = Z0 + H s + Q s (1 - s) for s > 0; Q > 0 grows early and then less, Q < 0 late."""

    form = "second_order"
    own_symbols = False
    summary = "The wheel digs in with slip by H metres at full slip; whether early (Q > 0) or late is left open."
    source = "any law to second order in slip; the published ones of 1969 to 2010 are near it or in it"
    parameters = (
        Parameter("H_m", "m", 0.0, 0.02, 0.0, 0.5, 0.05, "Yang Tab. 3: .02 clay, .08 sand", side=1),
        Parameter("Q_m", "m", 0.0, 0.01, -0.5, 0.5, 0.05, "as H_m: the law may bend as much as it rises"),
    )

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return the sinkage of a driven wheel."""
        s = conditions.driving_slip
        return static_sinkage + values["H_m"] * s + values["Q_m"] * s * (1.0 - s)


class SkidSinkage(Effect):
    """Z = Z0 + H2 s_b^2 for s_b < 0; the laws of slip sinkage do not hold there."""

    name = "skid_sinkage"
    summary = "A braked wheel digs itself in, slowly at first and by H2 metres when it is locked."
    source = "found on the public single-wheel tests of Pavlov & Johnson (2019): left-out rms 1 mm, linear 8 mm"
    parameters = (
        Parameter(
            "H2_m",
            "m",
            0.0,
            0.1,
            0.0,
            1.0,
            0.6,
            "Pavlov & Johnson (2019): 35 mm, wheel of 58 mm",
            side=1,
            in_radii=True,
        ),
    )
    needs = Needs(braking=True)

    def sinkage(self, static_sinkage: Number, conditions: Conditions, values: Values) -> Number:
        """Return the sinkage of a braked wheel."""
        slip = conditions.braking_slip
        return static_sinkage + values["H2_m"] * slip * slip


class ClosedFormSinkage(Effect):
    """From Eq. 11 or 12 put straight into Eq. 1 (blend 0) to the load-consistent solution (blend 1).

    Exists only where the simulation under test is the literal one; a balanced one is consistent already.
    """

    name = "closed_form_sinkage"
    summary = (
        "The simulation's sinkage does not carry the measured load: the soil keeps its balance, the formula does not."
    )
    source = "Yang et al. (2016), Eq. 7 against Eq. 10-12: the literal laws carry 1.05 to 1.25 W on clay, 2.4 W on sand"
    parameters = (
        Parameter("blend", "1", 0.0, 0.5, -0.5, 1.5, 0.5, "0 the paper's literal form, 1 the balance of Eq. 7"),
    )
    reading = "literal"

    def load_consistency(self, share: Number, values: Values) -> Number:
        """Return how much of the load-consistent solution counts."""
        return share + values["blend"] * (1.0 - share)
