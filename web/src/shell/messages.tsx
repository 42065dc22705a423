import { CircleAlert, CircleCheck, X } from "lucide-react";
import { useText } from "@/i18n/text";
import { removeMessage, useMessages } from "@/state/problems";
import { cn } from "@/ui/cn";

/** Short messages at the upper right: over the free end of the tabs, and never over the stop, the sticks or the mission. */
export function Messages() {
  const text = useText();
  const messages = useMessages((state) => state.messages);
  return (
    <ol
      aria-live="polite"
      className="pointer-events-none fixed top-[calc(var(--bar)+0.25rem)] right-[calc(var(--stop)+0.75rem)] z-55 flex w-[min(420px,calc(100vw-1.5rem))] flex-col gap-2 max-md:right-3"
    >
      {messages.map(({ number, tone, text: message, count }) => (
        <li
          key={number}
          role={tone === "problem" ? "alert" : undefined}
          className={cn("floating pointer-events-auto flex items-start gap-3 px-4 py-2", tone === "problem" && "border-attention")}
        >
          {tone === "problem" ? (
            <CircleAlert aria-hidden="true" className="mt-0.5 size-5 shrink-0 text-attention" />
          ) : (
            <CircleCheck aria-hidden="true" className="mt-0.5 size-5 shrink-0 text-alive" />
          )}
          <p className="min-w-0 grow break-words">
            {message}
            {count > 1 && <span className="ml-2 text-text-3 numeric">× {count}</span>}
          </p>
          <button type="button" aria-label={text("close")} onClick={() => removeMessage(number)} className="-m-2 grid size-9 shrink-0 place-items-center text-text-2 hover:text-text pointer-coarse:size-11">
            <X aria-hidden="true" className="size-4" />
          </button>
        </li>
      ))}
    </ol>
  );
}
