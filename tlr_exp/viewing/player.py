"""The clock by which a viewer plays a recording."""

from dataclasses import dataclass, field

from tlr_exp.pictures.recording import Recording


@dataclass
class Player:
    """Which state of a recording is shown as time goes by.

    Attributes:
        recording: what is played.
        playing: whether time goes by.
        loop: whether it begins again after the end; else it stops there.
        speed: seconds of the recording in a second.
    """

    recording: Recording
    playing: bool = True
    loop: bool = True
    speed: float = 1.0
    time_s: float = field(default=0.0, init=False)

    @property
    def frame(self) -> int:
        """The state that is shown now."""
        last = self.recording.num_frames - 1
        return min(int(self.time_s / self.recording.dt_s + 0.5), last)

    def seek(self, time_s: float) -> None:
        """Go to a time of the recording; beyond its ends, to its ends."""
        self.time_s = min(max(time_s, 0.0), self.recording.duration_s)

    def toggle(self) -> None:
        """Play or pause; at the end play from the beginning."""
        if not self.playing and self.frame == self.recording.num_frames - 1:
            self.time_s = 0.0
        self.playing = not self.playing

    def advance(self, elapsed_s: float) -> None:
        """Let ``elapsed_s`` go by on the wall clock.

        In a loop the last state is shown for as long as every other one.
        """
        if not self.playing:
            return
        time_s = self.time_s + self.speed * elapsed_s
        if self.loop:
            self.time_s = time_s % (self.recording.duration_s + self.recording.dt_s)
        else:
            self.seek(time_s)
            self.playing = time_s < self.recording.duration_s
