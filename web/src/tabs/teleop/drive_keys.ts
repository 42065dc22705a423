/** Driving by keyboard and gamepad: both become velocities of the robot, as fractions of the limits. */
import { useEffect, useRef, useState } from "react";
import { type Velocity, ZERO, isZero } from "@/safety/drive";
import { isShortcut } from "@/ui/keyboard";
import { isDialogOpen, useOpenDialogs } from "@/ui/open_dialogs";

/** By the key's position on the keyboard, so that W is above S on every layout. */
const KEYS: Record<string, Velocity> = {
  KeyW: { x: 1, y: 0, yaw: 0 },
  KeyS: { x: -1, y: 0, yaw: 0 },
  KeyA: { x: 0, y: 1, yaw: 0 },
  KeyD: { x: 0, y: -1, yaw: 0 },
  KeyQ: { x: 0, y: 0, yaw: 1 },
  KeyE: { x: 0, y: 0, yaw: -1 },
};

const STICK_DEAD_ZONE = 0.12;

/** The velocity that a set of pressed keys commands, as fractions of the limits. */
export function velocityOfKeys(pressed: Iterable<string>): Velocity {
  const sum = { ...ZERO };
  for (const code of pressed) {
    const step = KEYS[code];
    if (step === undefined) continue;
    sum.x += step.x;
    sum.y += step.y;
    sum.yaw += step.yaw;
  }
  const length = Math.max(1, Math.hypot(sum.x, sum.y));
  return { x: sum.x / length, y: sum.y / length, yaw: sum.yaw };
}

/** Calls `onMove` with every change of the pressed driving keys, and with zero when the page loses the focus or a dialog opens. */
export function useDriveKeys(onMove: (velocity: Velocity) => void): void {
  const move = useRef(onMove);
  useEffect(() => {
    move.current = onMove;
  });
  useEffect(() => {
    const pressed = new Set<string>();
    const onDown = (event: KeyboardEvent) => {
      // macOS reports no key that is let go while Cmd is down.
      if (event.metaKey || event.key === "Meta") letGo();
      if (!isShortcut(event) || isDialogOpen() || KEYS[event.code] === undefined) return;
      pressed.add(event.code);
      move.current(velocityOfKeys(pressed));
    };
    const onUp = (event: KeyboardEvent) => {
      if (pressed.delete(event.code)) move.current(velocityOfKeys(pressed));
    };
    const letGo = () => {
      if (pressed.size === 0) return;
      pressed.clear();
      move.current(ZERO);
    };
    window.addEventListener("keydown", onDown);
    window.addEventListener("keyup", onUp);
    window.addEventListener("blur", letGo);
    window.addEventListener("contextmenu", letGo); // nor does a browser report keys that are let go while a menu is open
    const stopWatching = useOpenDialogs.subscribe(({ count }) => count > 0 && letGo());
    return () => {
      stopWatching();
      window.removeEventListener("keydown", onDown);
      window.removeEventListener("keyup", onUp);
      window.removeEventListener("blur", letGo);
      window.removeEventListener("contextmenu", letGo);
      letGo();
    };
  }, []);
}

/** The velocity that a gamepad in the standard layout commands; its left shoulder button must be held. */
export function velocityOfGamepad(axes: readonly number[], deadManHeld: boolean): Velocity {
  if (!deadManHeld) return ZERO;
  const [x = 0, y = 0, turn = 0] = axes.map((value) => (Math.abs(value) < STICK_DEAD_ZONE ? 0 : value));
  return { x: -y || 0, y: -x || 0, yaw: -turn || 0 };
}

const DEAD_MAN_BUTTON = 4;

/**
 * The name of the gamepad that drives; null without one. Calls `onMove` at every frame while there is one, and with nothing but
 * zero until the gamepad was at rest: a stick that is pushed while the view opens does not drive.
 */
export function useGamepad(onMove: (velocity: Velocity) => void): string | null {
  const [name, setName] = useState<string | null>(null);
  const move = useRef(onMove);
  useEffect(() => {
    move.current = onMove;
  });
  useEffect(() => {
    let frame = 0;
    let hasRested = false;
    const end = () => {
      hasRested = false;
      move.current(ZERO);
    };
    const look = () => {
      const gamepad = navigator.getGamepads().find((each) => each?.connected === true && each.mapping === "standard");
      setName(gamepad?.id ?? null);
      if (gamepad) {
        const velocity = velocityOfGamepad(gamepad.axes, gamepad.buttons[DEAD_MAN_BUTTON]?.pressed === true);
        hasRested ||= isZero(velocity);
        if (hasRested) move.current(velocity);
      } else end();
      frame = gamepad ? requestAnimationFrame(look) : 0;
    };
    const begin = () => {
      if (frame === 0) look();
    };
    begin();
    window.addEventListener("gamepadconnected", begin);
    window.addEventListener("gamepaddisconnected", end);
    return () => {
      cancelAnimationFrame(frame);
      window.removeEventListener("gamepadconnected", begin);
      window.removeEventListener("gamepaddisconnected", end);
      end();
    };
  }, []);
  return name;
}
