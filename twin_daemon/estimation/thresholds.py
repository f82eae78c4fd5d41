"""Every number that estimation decides by, each with its unit, what it does and where it comes from.

`twin config thresholds` prints them as the page docs/thresholds.md; a test compares the two.
"""

from __future__ import annotations

from twin_daemon.hand.schema import NominalUncertainty


class Threshold(float):
    """A number with its `unit` ("1" for a share or a factor) and `why`: what it decides and where it comes from."""

    unit: str
    why: str

    def __new__(cls, value: float, unit: str, why: str) -> Threshold:
        self = super().__new__(cls, value)
        self.unit, self.why = unit, why
        return self

    def __getnewargs__(self) -> tuple[float, str, str]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return float(self), self.unit, self.why


class Count(int):
    """A whole number of `unit`, with `why` as a threshold has it."""

    unit: str
    why: str

    def __new__(cls, value: int, unit: str, why: str) -> Count:
        self = super().__new__(cls, value)
        self.unit, self.why = unit, why
        return self

    def __getnewargs__(self) -> tuple[int, str, str]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return int(self), self.unit, self.why


# -- variables and their priors ------------------------------------------------------------------------------

AT_BOUND_SHARE = Threshold(5e-3, "1", "of a variable's range: nearer than this to an end is on it")
ANCHOR_FACTOR = Threshold(2.0, "1", "belief about a positive value that is anchored to its start")
ANCHOR_SIGNED_SHARE = Threshold(0.05, "1", "of its range: the same for a value that may be 0 or change its sign")
CHANGED_BEFOREHAND = Threshold(0.1, "1", "probability that a remembered value has changed, before the recordings speak")
ZERO_START_FACTOR = Threshold(20.0, "1", "over its lower bound: where a positive value starts that the model has as 0")

PARAMETER_SIGMA = Threshold(
    NominalUncertainty().gain, "1", "of the logarithm of a nominal parameter: 20 % off is within 1.7 sigma"
)
SHARED_SPREAD = Threshold(
    0.1,
    "1",
    "of the logarithm of what all joints have more, sigma of each joint's own: one that has none of it is 10 sigma "
    "off, one with half of it 5",
)
DELAY_CYCLES = Threshold(
    0.5, "cycles", "between two readings, sigma of a recorded command's time: it takes effect at the robot's next cycle"
)
FREE_ONSET_SIGMA_S = Threshold(0.05, "s", "of the onset where no commands were recorded and it is estimated")
OFFSET_FLOORS = Threshold(
    1.0, "1", "standard deviations of its noise: sigma of a reading's zero, set as well as it is read"
)
REACTION_ERROR = Threshold(
    0.01, "1", "of the torques that moving neighbours cause: how well these are known from the measured motion"
)
END_SIGMA = Threshold(
    3.0, "sigma", "of its noise, a reading beyond an end of the joint's travel: from there how soft that end is matters"
)
DELAY_REACH = Threshold(3.0, "sigma", "bounds of the common delay: one late joint must not spoil the others")
NUISANCE_REACH = Threshold(12.0, "1", "as a factor, bounds of a nuisance: far enough to show that it has to move")

LEFT_OUT_FLOORS = Threshold(
    0.1, "floors", "mean square of what combinations of uncertain link masses leave out: a twentieth of a residual"
)
MOST_LINK_COMBINATIONS = Count(
    12, "combinations", "of link masses for a group: the base joint of a serial arm has some ten that low noise shows"
)

# -- the error that a right model leaves ---------------------------------------------------------------------

FLOOR_CHI_SQUARE = Threshold(
    3.0, "floors", "mean square of a joint that a right model leaves, as on held-out motion: no more is asked"
)
LEAST_NOISE_RAD = Threshold(1e-6, "rad", "of any reading: no joint is read better than that")
SPEED_SAMPLES = Count(5, "samples", "to either side, from which a speed is read that is not its noise")
LEAST_CORRELATION_S = Threshold(
    0.02, "s", "over which the residual of a right model repeats itself, at least: its servo's time counts"
)
FINER_STEPS = Threshold(
    4.0,
    "1",
    "time steps in one: the finer roll-out that tells the time step's error, and those that a change of an effect is "
    "looked for with",
)
MODEL_ERROR_RAD = Threshold(2e-3, "rad", "off even in a good model of a hand: the error to reckon with before a fit")
EXPECTED_CORRELATION_S = Threshold(0.1, "s", "of a fitted hand's residual, for data that have not been fitted yet")

# -- roll-outs -----------------------------------------------------------------------------------------------

PAST_S = Threshold(4.0, "s", "of commands before a roll-out, for delays and filters; for limits of rate at least")
DIVERGED_RAD = Threshold(10.0, "rad", "error that a simulation counts as which left the finite numbers")

# -- windows of recordings -----------------------------------------------------------------------------------

LEAST_PIECE_S = Threshold(1.2, "s", "of motion in one piece: shorter ones say little about what has a memory")
MOST_PIECE_S = Threshold(3.0, "s", "more than that, at most: a free roll-out forgets nothing, so that errors add up")
STILL_S = Threshold(0.12, "s", "in which a joint travels no more than its noise does: there a piece may start")
STILL_SIGMA = Threshold(3.0, "sigma", "of the slope of its samples by which a joint that is slower stands still")
BENDS = Threshold(
    4.0, "1", "times the variance that a cubic leaves of the samples around a start: a line that leaves more bends"
)
UNSCORED_S = Threshold(0.1, "s", "after a start, in which effects with a memory find their state")
BEFORE_CONTACT_S = Threshold(0.03, "s", "left out before a contact: its time is uncertain by as much")
AFTER_CONTACT_S = Threshold(0.15, "s", "left out after it, until what it did has died away")
LOOK_FOR_REST_S = Threshold(1.0, "s", "after a contact, in which the calmest start is looked for")
MOST_EXCERPT_S = Threshold(40.0, "s", "of a recording that a search takes whole; a longer one is sampled")
STRETCH_S = Threshold(8.0, "s", "of each stretch of a longer one")
START_FLOORS = Threshold(
    0.3, "floors", "of what a start's uncertainty may move a joint by that is taken for nothing: a tenth of a residual"
)
START_SHOWS = Threshold(1e-3, "sigma", "of what an uncertain start does that is more than rounding")
START_SLOPE_S = Threshold(0.06, "s", "to either side of a stretch's start, from which its velocity is read")

# -- parts of a hand -----------------------------------------------------------------------------------------

CONTACT_MARGIN_M = Threshold(
    1e-3, "m", "parts nearer than this count as touching, at first: shapes of models are no better"
)
CONTACT_EVERY_S = Threshold(0.02, "s", "between poses that are looked at for contacts")
CONTACT_POSES = Count(60, "poses", "along a recording, to see whether anything touches at all")
STIRS_SIGMA = Threshold(8.0, "sigma", "of its noise that a joint travels which moves at all: noise alone makes 5 of it")
LEAST_CLEAR_S = Threshold(2.0, "s", "of motion clear of contacts that a part is judged by; half of it held out")
MOST_PART_S = Threshold(45.0, "s", "of one part's motion: more costs in proportion and says little that is new")
ONSET_REACH_S = Threshold(0.15, "s", "bounds of a part's own correction of an estimated onset: what a lag can be")

# -- how sure a value is -------------------------------------------------------------------------------------

Z95 = Threshold(1.96, "sigma", "half-width of a 95 % interval of a normal distribution")
BOX_INFORMATION = Threshold(12.0, "1", "of a uniform belief over a variable's range: what bounds say of a value")
IDENTIFIABLE_SHARE = Threshold(0.1, "1", "of a uniform belief's width: a narrower interval is called identifiable")
WEAK_SHARE = Threshold(0.5, "1", "of it: a narrower one is called weak, a wider one not identifiable")
CONFUSED_CORRELATION = Threshold(0.9, "1", "of two values' errors from which they are said to trade off")
RELATIVE_FLOOR = Threshold(0.01, "1", "of the value: the narrowest half-width of an interval, by measured coverage")
BLOCK_S = Threshold(0.75, "s", "of motion in one block of a bootstrap: longer than residuals are correlated")
SATURATED_SHARE = Threshold(0.02, "1", "of the samples beyond an actuator's range: the recording is said to saturate")

# -- searches ------------------------------------------------------------------------------------------------

JACOBIAN_STEP = Threshold(1e-2, "1", "of a variable's range, towards its middle, for intervals")
DESCENT_STARTS = Count(3, "starts", "of least squares: on a real hand they differ by more than searches do")
DESCENT_SAMPLES = Count(64, "points", "around the model from which the other starts are chosen")
DESCENT_NEARNESS = Threshold(0.3, "1", "of the range: half of these points lie as near to the model")
FIRST_ITERATIONS = Count(6, "steps", "from each start of least squares")
DESCENT_ITERATIONS = Count(40, "steps", "from the best of them")
DESCENT_ROUNDS = Count(4, "rounds", "of a descent: each with new derivatives where the last one has stopped")
STALLED = Threshold(2e-2, "1", "of the cost: a round that gains less is the last")

MULTI_SAMPLES = Count(300, "points", "of a search from many starts")
MULTI_STARTS = Count(12, "starts", "of them that are descended from")
MULTI_FIRST_ITERATIONS = Count(10, "steps", "from each")
MULTI_FINISHED = Count(3, "ends", "that are descended from to the end")
MULTI_ITERATIONS = Count(60, "steps", "from each of these")
MULTI_SPREAD = Threshold(0.7, "1", "sigma of a value's logarithm among the points: a factor of two either way")
MULTI_SIGNED_SHARE = Threshold(0.02, "1", "of its range: the same for a value that is 0 or may change its sign")

BAYES_DIMENSIONS = Count(6, "variables", "that the Gaussian process searches, the strongest: it learns little in more")
BAYES_CALLS = Count(60, "calls", "of the Gaussian process")
BAYES_POLISH_ITERATIONS = Count(8, "steps", "of least squares on what it has found")
BAYES_TIME_SHARE = Threshold(0.4, "1", "of the time that it has where descents follow it")
BAYES_DESCENT_FIRST_ITERATIONS = Count(8, "steps", "from the model as it was, and from what it has found")
BAYES_DESCENT_ITERATIONS = Count(40, "steps", "from the better of them")
RANDOM_BATCH = Count(20, "points", "of a random search that are rolled out at once")
SWARM_PARTICLES = Count(10, "particles", "of the swarm, as in the dissertation that is compared with")
SWARM_OWN = Threshold(0.5, "1", "pull towards a particle's own best, from there")
SWARM_LEADER = Threshold(0.3, "1", "pull towards the swarm's best, from there")
SWARM_INERTIA = Threshold(0.9, "1", "of a particle's velocity that is kept, from there")
POLISH_ITERATIONS = Count(10, "steps", "once the onset that was estimated has been aligned anew")
POLISH_SHARE = Threshold(0.2, "1", "of a budget for these")

# -- trust region --------------------------------------------------------------------------------------------

TRUST_STEP = Threshold(3e-3, "1", "of a variable's range, for its derivative")
WIDER_STEPS = tuple(
    Threshold(times, "1", "times that step: how wide a derivative may have to be to see past what is rough")
    for times in (1.0, 4.0, 16.0)
)
TOO_STEEP = Threshold(
    1.5, "1", "times as steep by a step as by one that is four times as wide: what the short one saw is no slope"
)
NEAR_ZERO = Threshold(0.02, "1", "of the range: the size of a value nearer to its lower end")
SMALLEST_RADIUS = Threshold(1e-3, "1", "of the first step: a trust region that has shrunk below it ends a descent")
LEAST_AGREEMENT = Threshold(0.25, "1", "of the expected gain: a step that reaches less shrinks the region")
GOOD_AGREEMENT = Threshold(0.75, "1", "of it: a step that reaches more widens the region")
LEAST_ROOM = Threshold(
    1e-9, "1", "of a first step: a variable with less to its bound stands; with none no step is found"
)
SHRINK = Threshold(0.3, "1", "factor by which the region shrinks")
WORTH = Threshold(2e-4, "1", "of the cost: a step that promises less is the last")
PATTERN_FIRST = Threshold(0.04, "1", "of a value: first step of the pattern search across corners of dry friction")
PATTERN_LAST = Threshold(0.005, "1", "of a value: its last step")
LOG_SIZE = Threshold(0.1, "1", "of the range: what counts as the size of a logarithmic variable")

# -- what a set of motions lacks -----------------------------------------------------------------------------

LOAD_POSES = Count(400, "poses", "at random within the joints' ranges: what gravity can load a joint with at all")
LOADED_SHARE = Threshold(0.5, "1", "of that range, from which on a joint has been loaded")
FELT_LOAD_RAD = Threshold(1e-3, "rad", "by which a load has to bend a servo: less than a sensor reads is none")
TWO_SPEEDS = Threshold(
    3.0, "1", "between the fast and the slow tenth of the moving samples: two speeds, not one that varies"
)
LEAST_REVERSALS = Count(6, "turns", "three there and back: of fewer, chance decides what is play and what is friction")
HELD_S = Threshold(0.5, "s", "at one place, after which a servo has come to rest")
TWO_LOADS = Threshold(0.25, "1", "of the range of loads: two loads are so far apart")
MOTIONS_NAMED = Count(4, "parameters", "named for a motion, of those that it is the first to tell")
