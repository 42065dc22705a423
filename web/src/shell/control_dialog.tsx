import { type ConsoleState, hasControl, useConsole } from "@/api/console_store";
import { postJson } from "@/api/http";
import { AUTHORITY } from "@/generated/robot";
import { useIsControlStale } from "@/hooks/use_situation";
import { type TextKey, useText } from "@/i18n/text";
import { elsewhere } from "@/safety/elsewhere";
import { showProblem } from "@/state/problems";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { Dialog } from "@/ui/dialog";
import { HoldButton } from "@/ui/hold_button";

type Action = "take" | "request" | "grant" | "refuse" | "give_up" | "take_over";

async function lease(action: Action, from?: string): Promise<void> {
  try {
    await postJson("/_api/lease", from === undefined ? { action } : { action, from });
  } catch (error) {
    showProblem(error);
  }
}

/** Who has control; who had it last where that is of the past. */
export function controlText({ isStale, mine, holder }: { isStale: boolean; mine: boolean; holder: string | null }): TextKey {
  if (mine) return isStale ? "you_had_control" : "you_have_control";
  if (holder !== null) return isStale ? "other_had_control" : "other_has_control";
  return isStale ? "nobody_had_control" : "nobody_has_control";
}

/** Who has control, and how to get it. Opens by itself when somebody asks this browser for it. */
export function ControlDialog({ open, onOpenChange }: { open: boolean; onOpenChange: (open: boolean) => void }) {
  const text = useText();
  const state = useConsole();
  const { holder, requester, answer_within_s: leftS } = state.control;
  const seconds = leftS ?? AUTHORITY.requestS;
  const mine = hasControl(state);
  const isStale = useIsControlStale();
  const asked = mine && requester !== null && !isStale;

  return (
    <Dialog
      open={open || asked}
      onOpenChange={(next) => {
        if (!next && asked) void lease("refuse");
        onOpenChange(next);
      }}
      title={asked ? text("control_requested", { requester: requester ?? "" }) : text("control_title")}
      description={asked ? text("control_requested_explained", { seconds }) : text("control_explained")}
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
          <p className={cn("text-base", isStale && "text-text-3")}>{text(controlText({ isStale, mine, holder }), { holder: holder ?? "" })}</p>
          {state.session?.role === "viewer" ? (
            <p className="text-text-2">{text(elsewhere() === null ? "viewer_explained" : "elsewhere_no_command")}</p>
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
                  {requester === state.session?.name ? (
                    <p className="self-center text-text-2">{text("asked_for_control", { holder, seconds })}</p>
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
          {!isStale && <BrowserList {...state} />}
        </div>
      )}
    </Dialog>
  );
}

/** Who is connected now, and what each may do. */
function BrowserList({ browsers, session, control }: ConsoleState) {
  const text = useText();
  if (browsers.length === 0) return null;
  return (
    <section className="border-t border-line pt-4">
      <h3 className="mb-2 text-sm font-semibold text-text-2">{text("connected_now")}</h3>
      <ul className="flex max-h-48 flex-col gap-1 overflow-y-auto" data-testid="browsers">
        {browsers.map(({ name, role }) => (
          <li key={name} className="flex items-baseline justify-between gap-4">
            <span className={cn("min-w-0 wrap-anywhere", name === control.holder && "font-semibold")}>
              {name} {name === session?.name && <span className="text-text-3">({text("this_browser")})</span>}
            </span>
            <span className="shrink-0 text-sm text-text-2">
              {text(name === control.holder ? "browser_in_control" : role === "viewer" ? "browser_watches" : "browser_may_ask")}
            </span>
          </li>
        ))}
      </ul>
    </section>
  );
}
