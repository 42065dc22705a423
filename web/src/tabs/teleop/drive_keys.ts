/** Driving by keyboard and gamepad: both become velocities of the robot, as shares of the limit. */
import { useEffect, useState } from "react";
import { type Velocity, ZERO } from "@/safety/drive";

/** By the key's place on the keyboard, so that W is above S on every layout. */
const KEYS: Record<string, Velocity> = {
  KeyW: { x: 1, y: 0, yaw: 0 },
  KeyS: { x: -1, y: 0, yaw: 0 },
  KeyA: { x: 0, y: 1, yaw: 0 },
  KeyD: { x: 0, y: -1, yaw: 0 },
  KeyQ: { x: 0, y: 0, yaw: 1 },
  KeyE: { x: 0, y: 0, yaw: -1 },
};

const STICK_DEAD_ZONE = 0.12;

/** The velocity that a set of pressed keys asks for, in shares of the limits. */
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

/** Calls `onMove` with every change of the pressed driving keys, and with rest when the page loses them. */
export function useDriveKeys(onMove: (velocity: Velocity) => void): void {
  useEffect(() => {
    const pressed = new Set<string>();
    const onDown = (event: KeyboardEvent) => {
      const target = event.target;
      const typing = target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement;
      if (typing || event.repeat || event.ctrlKey || event.metaKey || event.altKey || KEYS[event.code] === undefined) return;
      pressed.add(event.code);
      onMove(velocityOfKeys(pressed));
    };
    const onUp = (event: KeyboardEvent) => {
      if (pressed.delete(event.code)) onMove(velocityOfKeys(pressed));
    };
    const letGo = () => {
      if (pressed.size === 0) return;
      pressed.clear();
      onMove(ZERO);
    };
    window.addEventListener("keydown", onDown);
    window.addEventListener("keyup", onUp);
    window.addEventListener("blur", letGo);
    return () => {
      window.removeEventListener("keydown", onDown);
      window.removeEventListener("keyup", onUp);
      window.removeEventListener("blur", letGo);
      letGo();
    };
  }, [onMove]);
}

/** The velocity that a gamepad in the standard layout asks for; its left shoulder button must be held. */
export function velocityOfGamepad(axes: readonly number[], deadManHeld: boolean): Velocity {
  if (!deadManHeld) return ZERO;
  const [x = 0, y = 0, turn = 0] = axes.map((value) => (Math.abs(value) < STICK_DEAD_ZONE ? 0 : value));
  return { x: -y || 0, y: -x || 0, yaw: -turn || 0 };
}

const DEAD_MAN_BUTTON = 4;

/** The name of the gamepad that drives; null without one. Calls `onMove` at every frame while there is one. */
export function useGamepad(onMove: (velocity: Velocity) => void): string | null {
  const [name, setName] = useState<string | null>(null);
  useEffect(() => {
    let frame = 0;
    const look = () => {
      const gamepad = navigator.getGamepads().find((each) => each?.connected === true && each.mapping === "standard");
      setName(gamepad?.id ?? null);
      if (gamepad) onMove(velocityOfGamepad(gamepad.axes, gamepad.buttons[DEAD_MAN_BUTTON]?.pressed === true));
      frame = gamepad ? requestAnimationFrame(look) : 0;
    };
    const begin = () => {
      if (frame === 0) look();
    };
    const end = () => onMove(ZERO);
    begin();
    window.addEventListener("gamepadconnected", begin);
    window.addEventListener("gamepaddisconnected", end);
    return () => {
      cancelAnimationFrame(frame);
      window.removeEventListener("gamepadconnected", begin);
      window.removeEventListener("gamepaddisconnected", end);
      end();
    };
  }, [onMove]);
  return name;
}
