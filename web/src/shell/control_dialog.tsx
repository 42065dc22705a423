import { hasControl, useConsole } from "@/api/console_store";
import { ask } from "@/api/http";
import { AUTHORITY } from "@/generated/robot";
import { useText } from "@/i18n/text";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { HoldButton } from "@/ui/hold_button";

type Action = "take" | "request" | "grant" | "refuse" | "give_up" | "take_over";

async function lease(action: Action, from?: string): Promise<void> {
  try {
    await ask("/_api/lease", from === undefined ? { action } : { action, from });
  } catch (error) {
    showProblem(error);
  }
}

/** Who has control, and how to get it. Opens by itself when somebody asks this browser for it. */
export function ControlDialog({ open, onOpenChange }: { open: boolean; onOpenChange: (open: boolean) => void }) {
  const text = useText();
  const state = useConsole();
  const { holder, requester } = state.control;
  const mine = hasControl(state);
  const asked = mine && requester !== null;

  return (
    <Dialog
      open={open || asked}
      onOpenChange={(next) => {
        if (!next && asked) void lease("refuse");
        onOpenChange(next);
      }}
      title={asked ? text("control_requested", { requester: requester ?? "" }) : text("control_title")}
      description={asked ? text("control_requested_explained", { seconds: AUTHORITY.requestS }) : text("control_explained")}
    >
      {asked ? (
        <div className="flex flex-wrap justify-end gap-3">
          <Button onClick={() => void lease("grant")}>{text("hand_over")}</Button>
          <Button kind="primary" onClick={() => void lease("refuse")}>
            {text("keep_control")}
          </Button>
        </div>
      ) : (
        <div className="flex flex-col gap-4">
          <p className="text-base">
            {mine ? text("you_have_control") : holder === null ? text("nobody_has_control") : text("other_has_control", { holder })}
          </p>
          {state.own?.role === "viewer" ? (
            <p className="text-text-2">{text("viewer_explained")}</p>
          ) : (
            <div className="flex flex-wrap gap-3">
              {mine && <Button onClick={() => void lease("give_up")}>{text("give_up_control")}</Button>}
              {!mine && holder === null && (
                <Button kind="primary" onClick={() => void lease("take")}>
                  {text("take_control")}
                </Button>
              )}
              {!mine && holder !== null && (
                <>
                  {requester === state.own?.name ? (
                    <p className="self-center text-text-2">{text("asked_for_control", { holder })}</p>
                  ) : (
                    <Button kind="primary" onClick={() => void lease("request")}>
                      {text("ask_for_control")}
                    </Button>
                  )}
                  <HoldButton tone="dark" onHeld={() => void lease("take_over", holder)}>
                    {text("take_over", { holder })}
                  </HoldButton>
                </>
              )}
            </div>
          )}
        </div>
      )}
    </Dialog>
  );
}
