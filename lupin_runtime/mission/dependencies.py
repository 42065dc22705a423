"""BOOT: wait for the servers that a mission needs."""

from __future__ import annotations

from lupin_runtime.mission.context import Context

# Navigation answers at once. A process that was killed, and is still discovered, never does.
CANCEL_ANSWER_WAIT_S = 2.0


class Dependencies:
    """Checks the servers. Unlike activities it also runs while the mission is blocked, since nothing moves in BOOT."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._boot_s: float | None = None
        self._cancel_since_s: float | None = None
        self._cancel_sent = False
        self._cancel_answered = False

    def missing(self) -> list[str]:
        """Return the names of the servers that are not available."""
        config, ports = self._context.config, self._context.ports
        required = [
            (config.nav_action_name, ports.navigation.is_ready()),
            (config.bridge_service_name, ports.climate_bridge.is_ready()),
        ]
        if config.require_visual_confirmation:
            required.append((config.visual_confirmation_service, ports.confirmer.is_ready()))
        return [name for name, ready in required if not ready]

    def tick(self) -> None:
        """Fire `deps_up` once all servers are available, or `fault` after the timeout."""
        context, now = self._context, self._context.now_s
        timeout_s = context.config.dependency_timeout_s
        if self._boot_s is None:
            self._boot_s = now
        missing = self.missing()
        if not missing:
            if self._old_goals_cancelled(now):
                context.fire("deps_up")
        elif now - self._boot_s >= timeout_s:
            context.last_error = "dependency_timeout"
            context.ports.publisher.log(
                f"not available after {timeout_s:.0f} s: {', '.join(missing)}; see: lupin status; then: lupin mission reset",
                warning=True,
            )
            context.fire("fault")

    def _old_goals_cancelled(self, now: float) -> bool:
        """Cancel what an orchestrator that crashed may have left running: no other process would.

        The request names no goal, so one that is sent before the answer could overtake it and be cancelled, too.
        """
        if self._cancel_since_s is None:
            self._cancel_since_s = now
        if not self._cancel_sent:
            self._cancel_sent = self._context.ports.navigation.cancel_all(self._on_cancel_answer)
        return self._cancel_answered or now - self._cancel_since_s >= CANCEL_ANSWER_WAIT_S

    def _on_cancel_answer(self) -> None:
        self._cancel_answered = True
