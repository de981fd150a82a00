"""The session on the operator's side: it samples the controller, shows the video, and asks."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import cv2
from msgspec.structs import replace

from hw.controller import Controller
from hw.desk.keyboard import KeyboardController
from hw.make_controller import keyboard_of, make_controller
from tams_app.config import Config
from tams_app.errors import ConfigError, HelperError, TamsError
from tams_app.link.gateway_client import NO_ANSWER, Endpoint, Gateway
from tams_app.link.messages import StateMessage, Welcome
from tams_app.records import LINK_LOST, OperatorGlance, SessionState, ShownFrame, ViewState
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import APPLICATION_PRIORITY, use_fifo, use_ordinary, use_round_robin
from tams_app.runtime.shared_ring import new_block_name
from tams_app.runtime.worker import Worker
from tams_app.session.awake import KeptAwake
from tams_app.session.ending import Ending
from tams_app.session.fresh_video import SteeredBy
from tams_app.session.recorders import LoadMonitor, Recorders
from tams_app.session.rig_operator import RigOperator
from tams_app.session.sentences import Sentences
from tams_app.session.status import pressed_buttons
from tams_app.session.two_sided.operator_link import OperatorLink, Requests
from tams_app.session.two_sided.operator_video import OperatorVideo
from tams_app.session.two_sided.welcome import follow, repair_of, welcome_of
from tams_app.summary.joined import OPERATOR_FACT, SESSION_FACT
from tams_app.teleop.hands import HAND_FACT, hand_of, words_of_hand
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.codec_choice import choose_codecs
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout

_CALL_POLL_NS = 50 * NS_PER_MS
_TELL_AFTER_NS = 2 * NS_PER_S  # of waiting, and again
_STOP_TOLD_S = 0.1
# the robot's side waits for one who fell silent, who may be the one who calls again
_BUSY = "another operator is connected, or was a moment ago: waiting until they leave"


class OperatorSession(Ending):
    """Start it, `poll` it a few times a second until `ended`, then `close` it; once."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        endpoint: Endpoint,
        say: Callable[[str], None],
    ) -> None:
        """`say` shows a sentence at once, while the start waits for the robot's side."""
        super().__init__(config, clock)  # its video becomes the robot's when it starts
        self._say = say
        self.folder = folder
        self.signals = Requests(clock)
        self.sentences = Sentences()
        self.keyboard: KeyboardController | None = None  # which the console's window has to feed
        self._endpoint = endpoint
        self._stack = ExitStack()
        self._helpers: dict[str, HelperProcess] = {}
        self._video: OperatorVideo | None = None
        self._welcome: Welcome | None = None
        self._silent = self._busy = False

    # --- start ----------------------------------------------------------------------------------

    def start(self) -> None:
        """Call the robot's side and start everything; what was started is stopped if it fails."""
        try:
            self._start()
        except BaseException:
            self._unwind()
            raise

    def _start(self) -> None:
        cv2.setNumThreads(1)
        if self.config.control.realtime_priority:
            use_round_robin(APPLICATION_PRIORITY)
            self._stack.callback(use_ordinary)
        helper_logs = self.folder / "helpers"
        helper_logs.mkdir(exist_ok=True)  # the window is there before
        self._gateway = gateway = Gateway("operator", self._endpoint, b"", helper_logs)
        self._stack.callback(gateway.close)
        gateway.launch()
        gateway.wait_ready()
        self._helpers["link"] = gateway.process
        self._welcome = welcome = self._call()
        if self.config.operator_is_simulated and not welcome.simulated:
            raise ConfigError("--sim: the robot there is real, and moves for a person only")
        self.config = follow(welcome, self.config)
        self._log = Recorders(
            self.config,
            self._clock,
            self.folder,
            self._on_worker_failure,
            self.sentences.note,
            self.signals.estop,
        )
        self._stack.callback(self._log.close)
        if not welcome.simulated:
            awake = KeptAwake(lambda text: self.note("warning", text))
            self._stack.callback(awake.close)
            awake.start()
        identity = secrets.randbits(62)
        self._log.fact(SESSION_FACT, welcome.session)
        self._log.fact(OPERATOR_FACT, str(identity))
        self._log.fact(HAND_FACT, hand_of(self.config))
        self._link = OperatorLink(
            self._clock,
            gateway,
            self.signals,
            self._log,
            self._steered_by,
            identity,
            hand_of(self.config),
        )
        self._start_video(welcome)
        hand = Worker("hand", self._hand_thread, self._on_worker_failure)
        self._stack.callback(hand.stop)
        hand.start()  # from now on the robot's side hears us
        self._start_controller(helper_logs)
        pids = {name: process.pid for name, process in self._helpers.items()}
        pids["ros2"] = self._log.bridge_pid
        running = {name: pid for name, pid in pids.items() if pid is not None}
        load = Worker(
            "load", LoadMonitor(self._clock, running, self._log.record).run, self._on_worker_failure
        )
        self._stack.callback(load.stop)
        load.start()

    def _call(self) -> Welcome:
        """Wait for the robot's side to answer; TamsError if we are ended before."""
        told_ns = self._clock.now_ns()
        busy = False
        where = f"{self._endpoint.host}:{self._endpoint.port}"
        while (welcome := welcome_of(self._gateway.event)) is None:
            self._gateway.receive()
            now_ns, event = self._clock.now_ns(), self._gateway.event
            if self._gateway.process.exit_code is not None:
                raise HelperError(f"the gateway ended unasked; see {self.folder}/helpers")
            if self._requested_end:
                raise TamsError(f"{self._requested_end} before the robot's side had answered")
            if self.time_is_up:
                what = "another operator was connected" if busy else NO_ANSWER
                raise TamsError(f"{what} (called {where} for {self.config.seconds:g} s)")
            if now_ns - told_ns >= _TELL_AFTER_NS or event.busy != busy:
                told_ns, busy = now_ns, event.busy
                self._say(_BUSY if busy else f"calling {where}: {NO_ANSWER}")
            self._clock.sleep_until_ns(now_ns + _CALL_POLL_NS)
        return welcome

    def _start_video(self, welcome: Welcome) -> None:
        video = self.config.video
        codecs = choose_codecs(video, False)
        for remark in codecs.remarks:
            self.note("warning", remark)
        self.screen = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
        self._stack.callback(self.screen.close)
        self._video = OperatorVideo(
            video,
            repair_of(welcome),
            welcome.feedback,
            self._clock,
            self._on_shown,
            codecs.decoder,
            self._robot_now_ns,
            self.signals.faces,
        )
        self._stack.callback(self._video.close)
        self._gateway.follow(self._video.start(self._gateway.entrance_port))

    def _start_controller(self, helper_logs: Path) -> None:
        controller = self._make_controller(helper_logs)
        self._stack.callback(controller.close)
        controller.start()
        if priority := self.config.control.realtime_priority:
            for thread_id in controller.realtime_thread_ids.values():
                use_fifo(priority - 1, thread_id)
        self._link.controller = controller

    def _make_controller(self, helper_logs: Path) -> Controller:
        if not self.config.operator_is_simulated:
            config = self.config
            controller = make_controller(
                config.controller, config.hand, config.clutch, self._clock, self.note
            )
            self.keyboard = keyboard_of(controller)
            return controller
        operator = RigOperator(
            self.config,
            self._clock,
            new_block_name(),
            self.screen,
            helper_logs,
            confirms=True,
            on_glance=self._record_glance,
            on_failure=self._on_worker_failure,
        )
        self._stack.callback(operator.close)
        self._helpers["operator"] = operator.launch()
        operator.wait_ready()
        self._log.fact("operator", operator.choice.kind)
        self.screen.hide()
        return operator.controller

    # --- while it runs --------------------------------------------------------------------------

    def poll(self) -> None:
        """Look after helpers, streams, the robot's side and the time limit."""
        for name, process in self._helpers.items():
            if process.exit_code is not None:
                self.fail(f"the helper process {name} ended unasked; see {self.folder}/helpers")
        if self._video is not None and (failure := self._video.poll()):
            self.fail(failure)
        self._look_at(self._link.state)
        self._end_if_due()

    def _look_at(self, state: StateMessage | None) -> None:
        event = self._link.event
        if welcome_of(event) != self._welcome:
            self.fail("the robot's side has begun another session: start this one again")
        if state is not None and state.ended:
            if state.failed:
                self.fail(f"the robot's side failed: {state.ended}")
            self.end(f"the robot's side: {state.ended}")
        elif event.left:
            self.end("the robot's side has ended the session")
        silent = self._hears_nothing()
        if silent and not self._silent:
            release = words_of_hand(hand_of(self.config)).release
            self.note(
                "warning",
                f"nothing is heard of the robot, whose arm stops by itself: {release}, "
                "and wait until the link is back",
            )
        if event.busy and not self._busy:
            self.note("warning", _BUSY)
        self._busy = event.busy
        self._silent = silent

    def fail(self, sentence: str) -> None:
        """The job has failed: let the session end with exit code 1, and with it the hand go."""
        if not self.failure:
            self.failure = sentence
            self.note("error", sentence)
        self.end(sentence)

    def note(self, level: str, text: str) -> None:
        """Keep a sentence in the log and show it."""
        self._log.note(level, text)

    def state(self) -> SessionState:
        """What the console shows at this moment: the robot's, and what is known here alone."""
        message, robots = self._link.state, SessionState(t_s=0.0, arming=LINK_LOST)
        if message is not None:
            robots = message.state
        return replace(
            robots,
            t_s=self.elapsed_s(),
            arming=LINK_LOST if self._hears_nothing() else robots.arming,
            hand=hand_of(self.config),
            pressed=pressed_buttons(self._link.sample),
            views={
                view: self._view(view, robots.views.get(view, ViewState()))
                for view in self.config.video.views
            },
            asked_fps=self.config.video.fps,
            now_ns=self._clock.now_ns(),
            heard_ns=None if message is None else self._link.state_heard_ns,
        )

    def _view(self, view: str, robots: ViewState) -> ViewState:
        """`robots`: of the view, as the robot's side knows it."""
        return replace(
            robots,
            given_fps=None if self._video is None else self._video.shown_fps(view),
            latency_ms=self._latency_ms(view),
            age_ms=self._age_ms(view),
        )

    def stop_arm(self) -> None:
        """Let go: the robot's side hears of a controller that is put down, and stops the arm."""
        self._link.controller = None
        self._clock.sleep_until_ns(self._clock.now_ns() + round(_STOP_TOLD_S * NS_PER_S))

    def close(self) -> None:
        """End everything in the reverse order of its start; what fails is kept in `failure`."""
        self._unwind()

    def _unwind(self) -> None:
        try:
            self._stack.close()
        except (TamsError, OSError) as failure:
            self.failure = self.failure or str(failure)

    def _hears_nothing(self) -> bool:
        """Of the robot's side, for so long that its arm was stopped."""
        if self._link.state is None or self._welcome is None:
            return True
        silent_ms = (self._clock.now_ns() - self._link.state_heard_ns) / NS_PER_MS
        return silent_ms > self._welcome.stopped_after_ms

    # --- called by the parts --------------------------------------------------------------------

    def _hand_thread(self, stop: threading.Event) -> None:
        use_fifo(self.config.control.realtime_priority)
        self._link.run(stop)

    def _on_worker_failure(self, name: str, failure: BaseException) -> None:
        sentence = str(failure) if isinstance(failure, TamsError) else f"{name}: {failure!r}"
        self.fail(sentence)

    def _on_shown(self, shown: ShownFrame) -> None:
        self._log.record(shown)
        self.screen.put(shown.view, shown.index, shown.shown_ns, shown.image)

    def _record_glance(self, glance: OperatorGlance) -> None:
        self._log.record(glance)

    def _steered_by(self) -> tuple[SteeredBy, ...]:
        """In the hand's thread: by view. What it heard before tells when the frames began."""
        video, state = self._video, self._link.state
        if video is None:
            return ()
        if state is not None:
            video.first_captures(state.first_capture_ns)
        return tuple(map(video.steered_by, self.config.video.views))

    def _robot_now_ns(self) -> int | None:
        state = self._link.state
        return None if state is None else state.sent_ns

    def _age_ms(self, view: str) -> float | None:
        video = self._video
        captured_ns = None if video is None else video.steered_by(view).capture_ns
        return self._since_capture_ms(captured_ns, self._clock.now_ns())

    def _latency_ms(self, view: str) -> float | None:
        shown = None if self._video is None else self._video.shown(view)
        if shown is None:
            return None
        return self._since_capture_ms(shown.capture_ns, shown.shown_ns)

    def _since_capture_ms(self, captured_ns: int | None, until_ns: int) -> float | None:
        """From a frame's capture, on the robot's clock, until then on ours."""
        offset = self._link.offset
        if captured_ns is None or offset is None:
            return None
        return (until_ns + offset.offset_ns - captured_ns) / NS_PER_MS
