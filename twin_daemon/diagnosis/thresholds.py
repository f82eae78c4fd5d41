"""Every number that a diagnosis decides by, beside those of estimation: its unit, what it does, where it comes from."""

from __future__ import annotations

from twin_daemon.estimation.thresholds import Count, Threshold

# -- candidates and their fits -------------------------------------------------------------------------------

WIDER = Threshold(10.0, "1", "times an effect's own starts: how far a fit may go")
COUNTED_NEARBY = Threshold(
    1.15, "1", "as a factor: so far from its start where a value counts something, such as teeth"
)
TAKEN_AWAY = Threshold(1.9, "1", "times its starts: a model's own friction can be taken away once, not thirty times")
LEAST_ALONG = Threshold(0.05, "1", "of a start: the nearest to neutral that a fit begins")
FURTHEST_ALONG = Threshold(4.0, "1", "times a start's own values, along its secant")
SCREENED_S = Threshold(8.0, "s", "of motion, where the model fails most: enough to rank candidates")
OWNERS_STARTS = Count(4, "starts", "rolled out of a candidate that stands for a nuisance")
OTHERS_STARTS = Count(2, "starts", "rolled out of any other candidate")
FINALISTS = Count(
    3,
    "candidates",
    "that are fitted on all motion, and that a search begins again with; twice as many where nuisances reach the floor",
)
COMPARABLE = Threshold(4.0, "1", "times the best cost: what is further off after its first fit is not fitted again")
RACE_ROLLOUTS = (
    Count(2, "roll-outs", "of every candidate in the first round of the race, beside those of its derivatives"),
    Count(3, "roll-outs", "of the better half in the second"),
    Count(6, "roll-outs", "of the better half of these in the third"),
    Count(12, "roll-outs", "of those that are left"),
)
ON_THE_WAY = Threshold(
    0.2,
    "1",
    "of what a further effect has to take away: where no candidate has come that far in the first round of the race, "
    "none will. Right ones had come all the way (three pairs of the development half), all beside a law of no library "
    "less than 0.1",
)
LEAST_RACING = Count(5, "candidates", "that a race leaves, fitted until they have settled")
FULL_FIT_ROLLOUTS = Count(12, "roll-outs", "of a finalist's fit on all motion beside those of its derivatives")
NUISANCE_ROLLOUTS = Count(12, "roll-outs", "of a round of the nuisances beside those of its derivatives")
STEP_ERROR_ROUNDS = Count(3, "times", "a group's values are settled with the time step's error where they have come to")
ASTRAY_FLOORS = Threshold(
    100.0,
    "floors",
    "that uncertain values which have lost their way may leave, and are then put back: 11 to 25 did",
)
SETTLED = Threshold(0.95, "1", "of the cost before: a round that gains less is the last")
GONE_FAR = Threshold(0.8, "1", "of its first cost: a descent that has come below it is taken up again")
ELSEWHERE_STEPS = Count(
    3, "steps", "in which values get to where they are in another session, of validation data that were recorded there"
)
REFIT_ROUNDS = Count(6, "rounds", "of the fit of one named effect, with new derivatives each")
REFIT_ROLLOUTS = Count(16, "roll-outs", "of each round, beside those of its derivatives")
REFIT_STARTS = Count(2, "starts", "of a named effect that are descended from, the best of its own")
COARSER_STEPS = Threshold(2.0, "1", "times the time step where differences of roll-outs are compared")
FOUND_SHARE = Threshold(0.5, "1", "of an effect's strength: its sigma while something else is still missing")
FOUND_LEAST_SHARE = Threshold(0.01, "1", "of its range: the least such sigma")

SHARED_SHARES = tuple(
    Threshold(share, "1", "of an effect's own start: where a cause of several groups begins")
    for share in (1.0, 0.3, 0.1, 0.03, 0.01)
)
OF_ALL_LEFT = Threshold(
    0.25,
    "1",
    "of the error, beside its floor: a cause of all servos that leaves more is asked again beside fitted nuisances",
)
SHARED_FINALISTS = Count(5, "causes", "behind several groups that are fitted, of all that were begun")
SHARED_TELLING = Count(4, "groups", "the furthest above their floors, that say where a cause of all of them begins")
SHARED_STEPS = tuple(
    Threshold(share, "1", "of a value that several groups share: its step for a slope, one for each round of its fit")
    for share in (0.1, 0.03, 0.01, 0.003)
)
SHARED_LAST_STEPS = Count(2, "rounds", "of these that a cause needs which a fit has taken near its end")
SHARED_SETTLED_NATS = Threshold(0.5, "nats", "that a step of such values promises: with less their fit ends")
SHARED_TAKEN = Threshold(
    0.75,
    "1",
    "of what is above the floor, from most groups: a cause that takes less of it is not fitted to its end; right ones "
    "take all but some floors",
)
SHARED_NEARER = Count(4, "steps", "of a group's nuisances before a cause of all servos is asked for in their stead")
SHARED_DAMPING = tuple(
    Threshold(
        share,
        "1",
        "of the steepest slope squared: damping of a step of such values, more each time that it gains nothing",
    )
    for share in (0.0, 1e-4, 1e-2, 1.0)
)
SHARED_HALVINGS = Count(3, "halvings", "of a load that is heavier than the motion stays in proportion")

# -- verdicts ------------------------------------------------------------------------------------------------

CLOSER_LOOK = Threshold(
    1.5,
    "floors",
    "mean square of a joint that is looked at again: right models leave 0.8 to 1.3 where what is uncertain is fitted",
)
MOST_OF_EXCESS = Threshold(
    0.5, "1", "of what such a joint leaves beyond its floor: an effect that takes less away bends a right model"
)
SURE_FLOOR_SIGMA = Threshold(
    3.0,
    "sigma",
    "of a nuisance or an offset from its prior: beyond it a part is not at its floor, however little is left",
)
LEAST_SHARE_OF_ERROR = Threshold(
    0.04, "1", "of the error at worse joints: where there is less, no cause is looked for beside them"
)
MOVED_SIGMA = Threshold(
    1.0, "sigma", "of a nuisance beside a candidate: the fit is begun once more with all of them nominal"
)
SUSPECT_SIGMA = Threshold(3.0, "sigma", "of a nuisance from its prior: it may stand in for something")
DEVIATING_SIGMA = Threshold(4.0, "sigma", "of a nuisance from its prior: something moves it")
COMMON_DELAY_SIGMA = Threshold(
    2.5,
    "sigma",
    "of the delay that all groups agree on, half a cycle each: no command waits for more than a cycle",
)
JOINTS_APART = Threshold(
    0.1,
    "1",
    "of a time step: how far apart the delays of joints seem that get their commands at once. A roll-out takes the "
    "mean of a command over its step, so that this is its error of second order",
)
HARDLY_FURTHER = Threshold(
    1.1, "1", "times that: where the same fit within a nat is no further off, it counts. Descents end so far apart"
)
SPOKEN_SIGMA = Threshold(2.0, "sigma", "of a nominal parameter, and outside its interval: said with its value")
FORBIDDEN_SIGMA = Threshold(6.0, "sigma", "of a nuisance: no hand that is called the same; something is missing")
DELAY_ROUNDS = Count(3, "rounds", "of looking for the nuisances at other delays: as long as each finds better ones")
NEXT_TO_NOTHING = Threshold(1e-3, "1", "of an effect beside all of it, by which is seen whether it does anything")
DECISIVE_NATS = Threshold(5.0, "nats", "between two candidates below which data do not choose (odds of 150 to 1)")
ALIKE = Threshold(0.1, "1", "of half the best cost: laws this close are not told apart by their form")
REFINEMENT = Threshold(0.03, "1", "of the first error: what a second effect at the same place has to take away, or")
MOST_OF_IT = Threshold(0.5, "1", "of what is left")
MOST_EFFECTS = Count(3, "effects", "that a part of the hand is searched for")
MOST_UNDETECTABLE = Threshold(
    1.0 / 3.0, "1", "of a servo's effects: a tenth stays undetected on rich motion, a half on one slow closing"
)

# -- probabilities -------------------------------------------------------------------------------------------

RIVAL_ODDS = Threshold(19.0, "1", "to one, against a candidate that is decisively behind: 0.95 for the best")
SURE = Threshold(0.95, "1", "least probability of a cause that is called explained")
LEAST_PROBABILITY = Threshold(0.01, "1", "of a set of causes that is listed")
UNKNOWN_PRIOR_ABOVE = Threshold(
    0.12, "1", "prior of a law of no library where a part is above the floor: the suite's share of such laws"
)
UNKNOWN_PRIOR_UNNAMED = Threshold(0.5, "1", "the same where no effect passes validation either")
UNKNOWN_PRIOR_WITHIN = Threshold(0.01, "1", "the same where a part is at the floor: all that the sensors show is right")
ADEQUACY_SLOPE = Threshold(
    3.0,
    "1",
    "power of what is left over what a right model may leave, as odds of such a law where one was found: set by "
    "`python -m bench.set_thresholds`",
)
ADEQUACY_SLOPE_WITHIN = Threshold(12.0, "1", "the same where only held-out motion is above the floor")
LEAST_ADEQUACY = Threshold(
    0.4,
    "1",
    "of what a right model may leave: a law that leaves less is no more probable for it, wrong ones do as well",
)
FURTHER_CAUSE_ODDS = Threshold(
    4.0, "1", "to one, against each further cause that an answer needs, beside one law of no library: two are a quarter"
)
TOO_WEAK = Threshold(
    0.4,
    "1",
    "probability that a robot at its floor lacks what these data are too weak to show: of the suite's such answers the "
    "share in which something weak was hidden",
)

# -- held-out validation -------------------------------------------------------------------------------------

ADEQUATE_FLOORS = Threshold(3.0, "floors", "held-out mean square up to which a model is right: wrong effects leave 9")
RELATIVE_ERROR = Threshold(
    0.02,
    "1",
    "of a joint's error that a right effect may leave: right ones left up to 0.016, friction in place of play 0.04",
)
AS_BEFORE = Threshold(1.5, "1", "times what a joint left that fitted well: it may not get worse by more")
FORGIVEN_OFFSET_SIGMA = Threshold(2.0, "sigma", "of a constant offset on held-out motion, not held against a model")

# -- how sure an effect's value is ---------------------------------------------------------------------------

SAME_VALUE = Threshold(
    0.05, "1", "of a value: servos that differ by less have one in common; laws of another form were 3 % off"
)

# -- the next experiment -------------------------------------------------------------------------------------

RANGE_MARGIN = Threshold(0.08, "1", "of a joint's range, kept at both ends")
WIDEST_RAD = Threshold(2.0, "rad", "of travel, about the middle of a wider range")
SPEED_SHARE = Threshold(0.8, "1", "of the velocity limit that a motion uses")
FASTEST_RAD_S = Threshold(4.0, "rad/s", "of an experiment where the hand allows more: a second stays readable")
SETTLE_S = Threshold(1.0, "s", "of rest before a motion whose predictions are compared")
EXPERIMENT_RATE_HZ = Threshold(125.0, "Hz", "of the predicted readings: the hand's own rate")
MOST_RIVALS = Count(3, "candidates", "that one experiment is to tell apart, beside the finding")
FEW_COMMANDS = Count(4, "commands", "up to which each is moved at length")
TELLING = Threshold(3.0, "floors", "of expected difference, rms: less is said to be little")

# -- what is shown -------------------------------------------------------------------------------------------

MOST_NAMED = Count(6, "effects", "named in a reason, of those that a motion could not have shown")
FAR_BEYOND_OTHERS = Threshold(
    3.0, "1", "times the worst error of joints that were judged: one that was not is no noise beyond it"
)
MUCH_TOUCHED = Threshold(0.5, "1", "of its motion in which a group touches something: above it that is said")
WORST_SHOWN = Count(12, "rows", "of joints and conditions where the model fails most")
