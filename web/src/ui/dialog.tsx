import { X } from "lucide-react";
import { Dialog as Radix } from "radix-ui";
import { type ReactNode, useCallback, useLayoutEffect } from "react";
import { useText } from "@/i18n/text";
import { Button } from "./button";
import { cn } from "./cn";
import { countDialog } from "./open_dialogs";
import { loopTab } from "./tab_loop";

interface DialogProps {
  open: boolean;
  onOpenChange: (open: boolean) => void;
  title: string;
  description?: string;
  children: ReactNode;
  /** A drawer at the right edge instead of a window in the middle. */
  drawer?: boolean;
  className?: string;
}

/** A floating surface with a title that holds the focus until it is closed. The stop bar stays above it. */
export function Dialog({ open, onOpenChange, title, description, children, drawer = false, className }: DialogProps) {
  const text = useText();
  useLayoutEffect(() => (open ? countDialog() : undefined), [open]);
  // A modal dialog of Radix would make the stop unreachable, too.
  const content = useCallback((element: HTMLDivElement | null) => (element === null ? undefined : loopTab(element)), []);
  return (
    <Radix.Root open={open} onOpenChange={onOpenChange} modal={false}>
      <Radix.Portal>
        {open && <div className="fixed inset-0 z-40 bg-void/60" aria-hidden="true" onClick={() => onOpenChange(false)} />}
        <Radix.Content
          ref={content}
          {...(description === undefined ? { "aria-describedby": undefined } : {})}
          onInteractOutside={(event) => event.preventDefault()}
          className={cn(
            "floating fixed z-50 flex max-h-[calc(100dvh-2rem)] flex-col overflow-hidden max-md:max-h-[calc(100dvh-var(--stop)-var(--tabs)-1.5rem)]",
            drawer
              ? "inset-y-3 right-[calc(var(--stop)+0.75rem)] w-[min(480px,calc(100vw-1.5rem))] max-md:inset-x-3 max-md:right-3 max-md:bottom-[calc(var(--stop)+var(--tabs)+0.75rem)] max-md:w-auto"
              : "top-1/2 left-[calc((100vw-var(--stop))/2)] w-[min(520px,calc(100vw-1.5rem))] -translate-x-1/2 -translate-y-1/2 max-md:top-[calc((100dvh-var(--stop)-var(--tabs))/2)] max-md:left-1/2",
            className,
          )}
        >
          <div className="flex items-start gap-3 border-b border-line px-5 py-4">
            <div className="min-w-0 grow">
              <Radix.Title className="text-base font-semibold">{title}</Radix.Title>
              {description !== undefined && (
                <Radix.Description className="mt-1 text-sm text-text-2">{description}</Radix.Description>
              )}
            </div>
            <Radix.Close asChild>
              <Button kind="quiet" size="icon" aria-label={text("close")} className="-my-1 -mr-2">
                <X />
              </Button>
            </Radix.Close>
          </div>
          <div className="min-h-0 grow overflow-y-auto px-5 py-4">{children}</div>
        </Radix.Content>
      </Radix.Portal>
    </Radix.Root>
  );
}
