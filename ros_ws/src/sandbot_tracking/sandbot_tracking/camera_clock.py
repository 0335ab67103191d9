"""The offset of a camera's clock from the robot's: roughly from the frames' arrival, to a frame from the sync LED.

The LED goes on at robot time T, published on /sync_led. In the frames it is off at t₀ and on at t₁ (camera time, middle
of the exposure e), so robot time = camera time + offset with

    T - t₁ - e/2  ≤  offset  ≤  T - t₀ + e/2.

Every edge gives such an interval; apart from drift, the offset lies in all of them. If stamps agree with the robot's
clock (0 is in the interval) the offset is 0, else it is the middle of the intervals' intersection.
"""

NANO = 1_000_000_000
NEAR_NS = NANO // 2
"""A frame whose stamp is this close to the robot's time on arrival is assumed to be stamped by the same clock."""
PATIENCE_NS = 10 * NANO
"""Camera time within which both the announcement of a flash and the flash itself must arrive."""
ARRIVALS = 20
"""Frames from whose arrival the offset of a camera without an LED is estimated."""
SET_NS = NANO
"""A clock that goes back, or runs ahead of the arrival of all earlier frames, by more than this was set."""
OLDER = 2
"""Frames in a row, each older than the newest, that are no frames out of order but a clock that went back."""
EARLY_NS = NANO // 20
"""The clock went ahead if a frame arrives sooner after its stamp than every earlier one, by more than this."""
DRIFT = 1e-4
"""Largest relative drift between two clocks."""


class CameraClock:
    """Estimates the offset from every frame's stamp and every LED edge; ``placed``: ``offset_ns`` is known."""

    def __init__(self, period_s: float, exposure_s: float, *, led: bool = True) -> None:
        """``led``: whether the camera has the sync LED in view."""
        self._has_led = led
        self._period_ns, self._half_exposure_ns = round(period_s * NANO), round(exposure_s * NANO / 2)
        self.placed = False
        self.offset_ns = 0
        self.edges = self.missed = self.unannounced = self.jumps = 0
        """LED edges both seen and announced; announced only; seen only; contradicting earlier ones."""
        self.warning = ""
        self.settings = 0
        """How often the clock was set."""
        self.behind_ns = 0
        """Robot time minus stamp when a frame came, as long as no LED edge was seen: an offset, or a delay."""
        self._restart()

    def _restart(self) -> None:
        self.placed, self.offset_ns = False, 0
        self._near = self._synced = False
        self._arrivals: list[int] = []
        self._first_ns: int | None = None
        self._last: tuple[int, bool] | None = None
        self._ahead_ns = 0
        """Largest stamp minus arrival time, i.e. of the frame with the least delay: a busy host may be seconds late."""
        self._bounds: tuple[int, int, int] | None = None
        self._announced: tuple[int, int | None] | None = None
        """Robot time of the announced edge, and the stamp of the first frame after the announcement."""
        self._seen: tuple[int, int] | None = None
        self._older = 0

    @property
    def half_width_ns(self) -> int | None:
        """Half-width of the offset's interval; None before the first LED edge."""
        return None if self._bounds is None else (self._bounds[1] - self._bounds[0]) // 2

    def led(self, robot_ns: int) -> None:
        """The LED has gone on at this robot time."""
        if self._announced is not None:
            self._miss()
        self._announced = robot_ns, None
        self._match()

    def stamped(self, t_ns: int, received_ns: int) -> None:
        """Any frame, also a repeated one, in order of arrival: whether the clock jumped by less than ``SET_NS``."""
        if self._last is None or self._first_ns is None:
            return
        step = t_ns - self._last[0]
        self._older = self._older + 1 if -SET_NS < step < 0 or (step == 0 and self._older) else 0
        # The very first frames may all have waited for their reader.
        early = EARLY_NS < t_ns - received_ns - self._ahead_ns < SET_NS and t_ns - self._first_ns > SET_NS
        if self._older == OLDER or early:
            self.jumps += 1
            self.warning = "stamps jumped: what comes until the LED is seen is misplaced"
            # What the LED has told holds no more.
            self._bounds, self._ahead_ns = None, max(t_ns - received_ns, self._ahead_ns)

    def frame(self, t_ns: int, received_ns: int, robot_ns: int | None, lit: bool) -> None:
        """A frame of this stamp, received at a time of the host's clock when the robot's clock was ``robot_ns`` (None:
        unknown so far), with the LED lit or not.
        """
        ahead_ns = t_ns - received_ns
        if self._last is not None:
            step = t_ns - self._last[0]
            if step < -SET_NS or ahead_ns - self._ahead_ns > SET_NS:
                announced = self._announced
                self._restart()
                self._announced = announced and (announced[0], None)
                self.warning = "clock was set"
                self.settings += 1
            elif step <= 0:
                return
            elif lit and not self._last[1]:
                self._seen = self._last[0], t_ns
        self._first_ns = t_ns if self._first_ns is None else self._first_ns
        if self._announced is not None and self._announced[1] is None:
            self._announced = self._announced[0], t_ns
        self._ahead_ns = ahead_ns if self._last is None else max(ahead_ns, self._ahead_ns)
        self._last = t_ns, lit
        self._match()
        if not self._synced:
            self._place_without_led(t_ns, robot_ns)
        self._give_up(t_ns)

    def _place_without_led(self, t_ns: int, robot_ns: int | None) -> None:
        """Before the first LED edge: find out whether this is the robot's clock."""
        assert self._first_ns is not None
        if robot_ns is None:
            # Without a robot there is no clock to compare with; wait a while in case one is heard.
            self.placed = t_ns - self._first_ns > PATIENCE_NS
            return
        self.behind_ns = robot_ns - t_ns
        self._near = self._near or abs(robot_ns - t_ns) <= NEAR_NS
        if not self._near and not self._has_led:
            self._place_by_arrival(robot_ns - t_ns)
            return
        self.placed = self._near
        if not self._near:
            self.warning = f"clock is off by about {(robot_ns - t_ns) * 1e-9:.1f} s: held until the LED is seen"
        elif self.warning.startswith("clock is off"):
            self.warning = ""

    def _place_by_arrival(self, behind_ns: int) -> None:
        """Without an LED, the frame with the least delay gives the best estimate of the offset."""
        self._arrivals = [*self._arrivals, behind_ns][-ARRIVALS:]
        if len(self._arrivals) == ARRIVALS and not self.placed:
            self.placed, self.offset_ns = True, min(self._arrivals)
            self.warning = f"clock is off by {self.offset_ns * 1e-9:.2f} s and has no LED: placed by when frames arrive"

    def _match(self) -> None:
        if self._announced is None or self._first_ns is None:
            return
        announced_ns = self._announced[0]
        if self.placed and self._first_ns + self.offset_ns > announced_ns - self._period_ns:
            # The camera started after the flash, so it never saw the LED go on.
            self._announced = None
        elif self._seen is not None:
            (dark, bright), self._seen = self._seen, None
            low, high = announced_ns - bright - self._half_exposure_ns, announced_ns - dark + self._half_exposure_ns
            if self.placed and not low - SET_NS <= self.offset_ns <= high + SET_NS:
                self.unannounced += 1
                return
            self._announced = None
            self._sync(announced_ns, low, high)

    def _sync(self, announced_ns: int, low: int, high: int) -> None:
        before, was_placed = self.offset_ns, self.placed
        self.edges, self.warning = self.edges + 1, ""
        if self._bounds is not None:
            slack = round(DRIFT * abs(announced_ns - self._bounds[2]))
            both = max(low, self._bounds[0] - slack), min(high, self._bounds[1] + slack)
            if both[0] <= both[1]:
                low, high = both
            else:
                self.jumps += 1
                self.warning = f"LED edges disagree: the clock jumped by {(both[0] - both[1]) * 1e-6:.0f} ms or more"
        self._bounds = low, high, announced_ns
        # If the camera was stopped before the flash, the last dark frame is old and the interval too wide.
        likely = low + min(high - low, self._period_ns + 2 * self._half_exposure_ns)
        self.offset_ns = 0 if low <= 0 <= high else (low + likely) // 2
        self.placed = self._synced = True
        moved = self.offset_ns - before
        if was_placed and abs(moved) > self._period_ns and not self.warning:
            self.warning = (
                f"clock was off by {moved * 1e-9:.3f} s until the LED was seen: what came before is misplaced"
            )

    def _give_up(self, t_ns: int) -> None:
        if self._announced is not None and t_ns - (self._announced[1] or t_ns) > PATIENCE_NS:
            self._announced = None
            self._miss()
        if self._seen is not None and t_ns - self._seen[1] > PATIENCE_NS:
            self._seen = None
            self.unannounced += 1

    def _miss(self) -> None:
        self.missed += 1
        self.warning = "LED was not seen"
