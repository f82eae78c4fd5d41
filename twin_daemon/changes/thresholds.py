"""Every number that a comparison of two sessions decides by: its unit, what it does, where it comes from."""

from __future__ import annotations

from twin_daemon.estimation.thresholds import Count, Threshold

# -- what is believed before the recordings speak ------------------------------------------------------------

SHARED_SIGMA = Threshold(0.3, "1", "of the logarithm of a parameter that both sessions share: the baseline says it")
SPIKE = Threshold(
    0.03, "1", "of a value: spread between sessions without wear, where no three versions say it of this hand"
)
SLAB = Threshold(0.5, "1", "of the logarithm of a parameter that has changed: from a third less to a half more")
NOTHING_CHANGED = Threshold(
    0.5, "1", "probability that nothing has, before the recordings speak; the rest is shared out"
)
APPEARS = Threshold(
    0.05, "1", "as probable as a change of what the earlier session has: an effect that it shows nothing of"
)
TEMPERATURE = Threshold(
    0.1,
    "1",
    "of friction's logarithm, by one standard deviation of the temperature: 3 K, and 3 % a kelvin, as of most greases",
)
COLD_TO_WARM = Threshold(
    2.0, "1", "standard deviations of a temperature that nobody has told: from the coldest day to the warmest"
)
SHARED_UNITS = Threshold(1.0, "units", "of an effect's typical size: how strong it may be in both sessions")
ABSENT = Threshold(1e-3, "units", "of an effect's typical size: spread of one that is neither seen nor suspected")
SPIKE_UNITS = Threshold(0.03, "units", "of that size: spread between sessions without wear")
SLAB_UNITS = Threshold(1.0, "units", "of that size: an effect that has appeared or grown")

# -- the search ----------------------------------------------------------------------------------------------

ROUNDS = Count(24, "steps", "of Gauss-Newton in roll-outs, at most")
SETTLED_NATS = Threshold(0.2, "nats", "that a step has to gain to be followed by another")
PARAMETER_STEP = Threshold(
    0.03, "1", "of the logarithm of a parameter, for a derivative: across what friction roughens"
)
EFFECT_STEP = Threshold(0.15, "units", "of an effect's typical size, for its derivative once it is in the model")
ONSET_STEP_S = Threshold(1e-3, "s", "for the derivative by a delay")
FINALISTS = Count(2, "changes", "of parameters in a group that are refitted, and every effect that promises anything")
MOTOR_SHARE = Threshold(0.1, "1", "of armature on the motor's side, where a transmission gives or has play")
DAMPING_SHARE = Threshold(
    0.5, "1", "of a joint's damping on the motor's side of a transmission that gives, as it is believed at first"
)
DAMPING_SHARE_SIGMA = Threshold(0.25, "1", "of that share: one standard deviation of what is believed")
CREEPS = tuple(
    Threshold(
        creep, "1", "of the joint's own friction at rest: laws of load friction that are tried, held and creeping"
    )
    for creep in (0.0, 1.0)
)
FIRST_ROUNDS = Count(3, "steps", "of Gauss-Newton after which a change that is far behind is left alone")
COMPARABLE_NATS = Threshold(30.0, "nats", "behind the best: what is further behind then is not fitted to the end")
FURTHER_SHARE = Threshold(0.1, "1", "of the first change's evidence that another one at the same joints has to bring")
MOST_CHANGES = Count(3, "changes", "that are looked for in one group")
WORTH_REFITTING = Threshold(0.0, "nats", "over no change, to first order: a finalist with less is not refitted")
PRESENT_NATS = Threshold(8.0, "nats", "of the earlier session's evidence, for an effect to be put into both models")
PRESENT_START = Threshold(1.0, "units", "of an effect's typical size, from which one of the earlier session is fitted")
PRESENT_SHARE = Threshold(0.8, "1", "of the cost before: what an effect of both models has to leave at most")
WITHIN = Threshold(1.5, "floors", "that the earlier session may leave: then no effect is looked for in it")
SHORT_STEP = Threshold(
    0.1, "sigma", "of the priors: how far the first step goes where a fit that began with one sigma leaves more"
)
MOST_PRESENT = Count(2, "effects", "that are put into it")

# -- what is said --------------------------------------------------------------------------------------------

NAMED = Threshold(0.9, "1", "probability from which a change is called one")
POSSIBLE = Threshold(0.1, "1", "probability from which another change is said to explain the same")
TOLD_APART_NATS = Threshold(3.0, "nats", "of evidence by which a change has to beat another that explains the same")
IN_SERIES_NATS = Threshold(
    10.0, "nats", "the same for a weaker servo and a softer tendon: what the motor's share of inertia may make of them"
)
NEARBY = Threshold(0.1, "sigma", "of the posterior, about a fit: how far points are that are as good as the same")
DRAWN = Count(8, "points", "there, whose costs say how rough the cost is")
ROUGH = Threshold(2.0, "1", "times that roughness is the least by which one change has to beat another, too")
SEEN = Threshold(0.95, "1", "probability that the smallest change which would have been seen would have had")
VISIBLE = Threshold(
    0.7,
    "1",
    "of the logarithm of a parameter: where even a factor of two would not have been seen, nothing is said of it",
)
VISIBLE_UNITS = Threshold(3.0, "units", "the same for an effect, in its typical size")
LOAD_FRICTION_ERROR = Threshold(
    0.09,
    "1",
    "of the logarithm of a coefficient, one sigma: how far it is off beyond what the recordings say, as measured by "
    "bench.changes on its development seeds",
)
TENDON_ERROR = Threshold(
    0.16, "1", "the same of a tendon's stiffness: what its motor's share of inertia, which nobody knows, may make of it"
)
AS_GOOD_AS_NONE = Threshold(0.1, "1", "of what there is now of an effect: with less before no ratio of the two is said")
LEFT_OVER = Threshold(
    2.5, "1", "times the earlier session's mean squared rows: more in the later one is a change that has no name"
)
BLOCK_SAMPLES = Count(50, "samples", "of held-out motion that a bootstrap draws together")
