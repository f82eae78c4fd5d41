"""Every number that a proposal decides by, beside those of a diagnosis: its unit, what it does, where it comes from."""

from __future__ import annotations

from twin_daemon.estimation.thresholds import Count, Threshold

# -- the motion that is looked at ----------------------------------------------------------------------------

MOST_TRAIN_S = Threshold(20.0, "s", "of motion that laws are fitted to: each of a law's values is a roll-out of it")
MOST_HELD_S = Threshold(16.0, "s", "of held-out motion that they are validated on")
MOST_NEIGHBOURS = Count(3, "joints", "nearest to the one that lacks a law, on whose angles it may depend")
SMOOTHED_S = Threshold(0.06, "s", "of measured angles in one window of the filter: a law's speed is read off them")

# -- what a law may depend on --------------------------------------------------------------------------------

POSITION_KNOTS = Count(22, "knots", "of a curve over the angle, between the ends of what was visited")
FINE_POSITIONS = Count(64, "knots", "of another one, for what repeats within a tenth of what was visited")
FEW_POSITIONS = Count(8, "knots", "of a curve over the angle that is multiplied by the direction or the servo's error")
TIME_KNOTS = Count(6, "knots", "of a curve over time")
HEAT_KNOTS = Count(5, "knots", "of a curve over the servo's heat")
COMMAND_KNOTS = Count(14, "knots", "of a curve over the command")
NEIGHBOUR_KNOTS = Count(6, "knots", "of a curve over a neighbour's angle")
ORIENTATION_KNOTS = Count(8, "knots", "of a curve over the direction of gravity in the link")
LEAST_ACROSS = Threshold(
    0.05, "1", "of gravity across a joint's axis, all the time: with less its direction says nothing"
)
OWN_ANGLE_RAD = Threshold(
    0.05, "rad", "rms that other joints turn a link by: below, its orientation is the joint's own angle"
)
BENDS = tuple(
    Threshold(share, "1", "of the largest speed or error, either side of none: where a curve over it may bend")
    for share in (0.02, 0.07, 0.2, 0.5, 1.0)
)
FRICTION_BENDS = tuple(
    Threshold(share, "1", "of the largest speed: where a level of friction may bend, nearest to rest")
    for share in (0.004, 0.02, 0.07, 0.25, 1.0)
)
LOAD_BENDS = tuple(
    Threshold(share, "1", "of the largest load: where a curve over it may bend") for share in (0.1, 0.3, 1.0)
)
FEW_BENDS = tuple(
    Threshold(share, "1", "of the largest acceleration or neighbour's speed: where a curve over it may bend")
    for share in (0.05, 0.3, 1.0)
)
PLAY_RAD = tuple(
    Threshold(width, "rad", "widths of the elements of a law with play") for width in (0.01, 0.03, 0.1, 0.3)
)
TIMES_S = tuple(
    Threshold(time, "s", "of the elements of a law that relaxes or creeps: up to as long as the motion is")
    for time in (0.1, 0.4, 1.5, 6.0, 20.0)
)
LAGS_S = tuple(
    Threshold(time, "s", "of the elements of a command that arrives late: what has come through each low-pass of it")
    for time in (0.01, 0.03, 0.1, 0.3)
)
RATES = tuple(
    Threshold(share, "1", "of the joint's largest speed: limits of the command's rate that are tried")
    for share in (0.35, 0.5, 0.7, 1.0, 1.4)
)
SETTLING_S = Threshold(
    0.01, "s", "of the low-pass on an acceleration: a torque that follows the acceleration at once has no roll-out"
)
HEATING_S = Threshold(8.0, "s", "time constant of a servo's heat: its squared error through a low-pass")
LARGEST_RAD = Threshold(0.5, "rad", "of the servo's stiffness, or of a reading: the largest value of a curve")
LARGEST_FACTOR = Threshold(3.0, "1", "the largest value of a curve that is multiplied by the servo's error")
LARGEST_RELAXING = Threshold(4.0, "1", "times the servo's stiffness: the strongest element that relaxes")
STRONGEST_RAD = Threshold(
    3.0, "rad", "of the servo's stiffness: no law's torque is larger in a roll-out, however a trial goes astray"
)

# -- descents ------------------------------------------------------------------------------------------------

NUISANCE_REACH = Threshold(
    3.0, "sigma", "bounds of what is uncertain about a model: what lies further off is a change, and for a law to say"
)
NUISANCE_STEP = Threshold(0.02, "1", "of a nuisance's range, for its derivative: an eighth of its sigma")
LAW_STEP = Threshold(4e-3, "1", "of a coefficient's range: 4 mrad of the servo's stiffness")
DAMPINGS = tuple(
    Threshold(damping, "1", "of the curvature along each coordinate: of these steps the one that fits best counts")
    for damping in (0.0, 0.03, 1.0, 30.0)
)
STEP_LENGTHS = tuple(
    Threshold(length, "1", "of the linear step: of these lengths the one that roll-outs like best counts")
    for length in (1.0, 0.5, 0.2)
)
LEAST_STEP_GAIN = Threshold(3e-3, "1", "of the cost: a round that gains less is the last")
RIDGE = Threshold(1.0, "1", "of the largest coefficient that is looked for: the sigma of each")
SMOOTHNESS = tuple(
    Threshold(weight, "1", "weights of a curve's bends: of these the one that held-out blocks like best counts")
    for weight in (3.0, 30.0, 300.0)
)
FOLDS = Count(5, "blocks", "in time, each left out once from the linear step")

# -- the competition -----------------------------------------------------------------------------------------

RACING = Count(8, "laws", "that promise most by one step: fitted in roll-outs")
RACING_ROUNDS = Count(2, "rounds", "of Gauss and Newton for each of them")
PLAIN_SHARE = Threshold(0.9, "1", "of the error taken away by one step: then no finer curve is asked for")
LEADING = Count(3, "laws", "that go on")
ROUNDS = Count(4, "rounds", "of Gauss and Newton for each of these, and for the model without a law")

# -- formulas ------------------------------------------------------------------------------------------------

CURVE_BLUR = Threshold(0.03, "1", "of a curve's span: what a piecewise linear curve gets wrong of a smooth one")
DENSE_KNOTS = Count(320, "knots", "close enough for any formula: a sine of 16 waves has 20 a wave")
FASTER = Threshold(1.5, "1", "times the largest speed or error that was visited: other motion may be faster")
BEYOND = Threshold(0.1, "1", "of the visited range, to either side: a formula knows how it goes on")
FORMULAS_RACING = Count(16, "formulas", "of the shortest descriptions of the curve, each of which gets a roll-out")
FORMULAS_TRIED = Count(2, "formulas", "that roll-outs like best, fitted in them")
STOP_DEPTHS = tuple(
    Threshold(depth, "1", "of what was visited: how far before its end a stop may begin") for depth in (0.02, 0.06, 0.2)
)
STOP_STIFFNESSES = tuple(
    Threshold(times, "1", "times the servo's stiffness: of a stop, where a fit may begin") for times in (0.7, 2.5, 9.0)
)
UNDECIDED_NATS = Threshold(3.0, "nats", "between two laws: 20 to 1; below, held-out motion chooses")
FORMULA_ROUNDS = Count(3, "rounds", "of Gauss and Newton for the values of a formula")
FORMULA_MOVES = Count(5, "times", "that these rounds are done at most, while they gain or reach the end of a range")
FORMULA_GAIN = Threshold(0.05, "1", "of the cost: rounds that gain less are the last")
FORMULA_FLOOR = Threshold(0.03, "1", "of a formula's value: the least half-width of its interval")
CLOSER = Threshold(0.35, "1", "of the step between lengths that are tried for one element, in logarithms: the next")
CLOSER_LOOKS = Count(3, "looks", "at five lengths each, the first as far apart as a memory's elements")
SPOKEN_SHARE = Threshold(0.1, "1", "of a memory's strongest element: weaker ones are not named")

# -- what is proposed ----------------------------------------------------------------------------------------

MOST_TERMS = Count(3, "laws", "at one joint: with more any curve is a sum of something")
LEAST_GAIN = Threshold(0.15, "1", "of the held-out error: a law that takes less away is not proposed")
NULL_DRAWS = Count(39, "draws", "of errors moved in time, so that nothing depends on anything")
MOST_NULL = Threshold(0.05, "1", "of these that fit as well: with more, a law is not proposed")
LIBRARY_LEAVES = Threshold(
    0.9, "1", "of a law's error, fitted and held out: where an effect of the library leaves less of both, it is no news"
)
MOST_SURE = Threshold(
    0.95, "1", "probability of a law that nobody has tested on purpose, at most: something else may lie behind it"
)
NEAREST_SHOWN = Count(4, "effects", "of the library that come nearest, named with why they fail")
