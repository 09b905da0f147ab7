"""Whether the measured force can be true and is held; figures of the force for the operator."""

from __future__ import annotations

import math

OLDEST_WRENCH = 0.2  # s, from which a measurement is not used
MEMORY = 10.0  # s, over which the figures are means
HOLD_TIME = 4.0  # s, over which a force that is not held shows
CHATTER_TIME, CHATTER_MEMORY = 0.1, 0.4  # s: what is faster than the loop, and for how long
LEAST_CHATTER, CHATTER_SHARE = 3.0, 0.2  # N; of the desired force
CHATTER_PAUSE, CHATTER_FORGOTTEN, MOST_CHATTERS = 0.4, 10.0, 6
MOST_FORCE, LEAST_OVER = 2.0, 15.0  # of the desired force; N beyond it
LEAST_PULL, PULL_TIME = 3.0, 0.05  # N, s: a wall cannot pull
STUCK_TIME = 0.5  # s
LEAST_JUMP, JUMP_SHARE, JUMP_WAY = 10.0, 0.4, 1.5e-3  # N; of the desired force; m
OFF, TOUCHING = 0.5, 1.5  # N, below and above which that is sure


class ForceWatch:
    """
    Watch the force on the wall.

    Attributes
    ----------
    stamp : float
        Of the last measurement [s].
    mean, rms : float
        Of the force, and of its error, over the last seconds [N].
    share_off : float
        Share of that time off the wall.

    """

    def __init__(self) -> None:
        self.stamp = -math.inf
        self.mean = self.rms = self.share_off = 0.0
        self._force = 0.0
        self.begin()

    def begin(self) -> None:
        """Forget what was wrong: the head looks for the wall."""
        self._fault = ''
        self._low = self._fast = 0.0
        self._same_since = self._sound_at = self.stamp
        self._chatters, self._chattered_at = 0, -math.inf
        self.begin_contact()

    def begin_contact(self) -> None:
        """Forget how far the force was from the desired one: that is another one now."""
        self._error = 0.0

    def add(
        self, stamp: float, force: float, desired: float, stiffness: float, is_repeated: bool
    ) -> None:
        """
        Note a measurement.

        Parameters
        ----------
        stamp : float
            [s].
        force, desired : float
            On the wall; 0 is desired while there is no contact [N].
        stiffness : float
            Of the contact [N/m].
        is_repeated : bool
            Whether the wrench is to the last digit the one before, which none of a sound
            sensor is for long.

        """
        interval = min(max(stamp - self.stamp, 0.0), OLDEST_WRENCH)
        change, self._force, self.stamp = force - self._force, force, stamp
        if force > -LEAST_PULL:
            self._sound_at = stamp
        if not is_repeated:
            self._same_since = stamp
        if desired > 0.0:
            self._look_for_jump(change, desired, stiffness)
        self._low += _share(interval, CHATTER_TIME) * (force - self._low)
        self._fast += _share(interval, CHATTER_MEMORY) * ((force - self._low) ** 2 - self._fast)
        error = (force - desired) ** 2
        if force > TOUCHING:  # a wall that is gone is looked for again
            self._error += _share(interval, HOLD_TIME) * (error - self._error)
        share = _share(interval, MEMORY)
        self.mean += share * (force - self.mean)
        self.rms = math.sqrt(self.rms ** 2 + share * (error - self.rms ** 2))
        self.share_off += share * (float(force < OFF) - self.share_off)

    def chatters(self, desired: float) -> bool:
        """Return whether the force changes faster than the loop can; once for each pause."""
        bound = max(LEAST_CHATTER, CHATTER_SHARE * desired)
        since = self.stamp - self._chattered_at
        if since > CHATTER_FORGOTTEN:
            self._chatters = 0
        if since < CHATTER_PAUSE or self._fast < bound ** 2:
            return False
        self._chatters, self._chattered_at = self._chatters + 1, self.stamp
        return True

    def fault(self, final: float, desired: float, most_error: float) -> str:
        """
        Return what is wrong, empty if nothing is.

        Parameters
        ----------
        final, desired : float
            Force to hold in the end, and now [N].
        most_error : float
            By how much the force may miss it, RMS [N].

        """
        if self._fault:
            return self._fault
        force = self._force
        most = max(MOST_FORCE * final, final + LEAST_OVER)
        if force > most:
            return f'{force:.1f} N on the wall, bound {most:.1f} N'
        if self.stamp - self._sound_at > PULL_TIME:
            return (f'the wall pulls with {-force:.1f} N, which no wall can: is the sign of '
                    'contact_wrench wrong, or its zero?')
        if self.stamp - self._same_since > STUCK_TIME:
            return f'contact_wrench is stuck at {force:.1f} N for {STUCK_TIME:g} s'
        return self._not_held(desired, most_error)

    def _not_held(self, desired: float, most_error: float) -> str:
        if self._chatters > MOST_CHATTERS:
            return (f'the force chatters by {math.sqrt(self._fast):.1f} N RMS: the contact is too '
                    'stiff for what the prediction leaves over')
        error = math.sqrt(self._error)
        if error > most_error:
            return (f'the force misses the desired {desired:.1f} N by {error:.1f} N RMS, bound '
                    f'{most_error:.1f} N')
        return ''

    def _look_for_jump(self, change: float, desired: float, stiffness: float) -> None:
        bound = max(LEAST_JUMP, JUMP_SHARE * desired, JUMP_WAY * stiffness)
        if abs(change) > bound:
            self._fault = (f'contact_wrench jumped by {change:+.1f} N between two measurements, '
                           f'bound {bound:.1f} N')


def _share(interval: float, time: float) -> float:
    return 1.0 - math.exp(-interval / time)
