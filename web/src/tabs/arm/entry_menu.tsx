import { EllipsisVertical, PencilLine, Trash2 } from "lucide-react";
import { DropdownMenu } from "radix-ui";
import { useState } from "react";
import { SERVICES } from "@/generated/graph";
import { useText } from "@/i18n/text";
import { call } from "@/robot/commands";
import { showAnswer } from "@/state/problems";
import { Button } from "@/ui/button";
import { Dialog } from "@/ui/dialog";
import { HoldButton } from "@/ui/hold_button";
import { NameDialog } from "./name_dialog";

interface EntryMenuProps {
  kind: "pose" | "sequence";
  name: string;
  taken: readonly string[];
  disabled: boolean;
  onChanged: () => void;
}

const ITEM = "flex min-h-11 cursor-pointer items-center gap-3 rounded-sm px-3 text-sm outline-none data-[highlighted]:bg-hover";

/** Rename and delete for an entry of the library. */
export function EntryMenu({ kind, name, taken, disabled, onChanged }: EntryMenuProps) {
  const text = useText();
  const [asked, setAsked] = useState<"rename" | "delete" | null>(null);

  async function edit(newName: string): Promise<boolean> {
    const isDone = await showAnswer(call(SERVICES.ARM_LIBRARY_DELETE, { kind, name, new_name: newName }));
    onChanged();
    return isDone;
  }

  return (
    <>
      <DropdownMenu.Root modal={false}>
        <DropdownMenu.Trigger asChild>
          <Button kind="quiet" size="icon" disabled={disabled} aria-label={text("arm_more", { name })}>
            <EllipsisVertical />
          </Button>
        </DropdownMenu.Trigger>
        {/* Within the tab, so that it belongs to a landmark. */}
        <DropdownMenu.Portal container={document.getElementById("view")}>
          <DropdownMenu.Content align="end" className="floating z-50 min-w-44 p-1.5">
            <DropdownMenu.Item className={ITEM} onSelect={() => setAsked("rename")}>
              <PencilLine aria-hidden="true" className="size-4" />
              {text("arm_rename")}
            </DropdownMenu.Item>
            <DropdownMenu.Item className={ITEM} onSelect={() => setAsked("delete")}>
              <Trash2 aria-hidden="true" className="size-4" />
              {text("arm_delete")}
            </DropdownMenu.Item>
          </DropdownMenu.Content>
        </DropdownMenu.Portal>
      </DropdownMenu.Root>
      {asked === "rename" && (
        <NameDialog
          title={text("arm_rename_title", { name })}
          submitLabel={text("arm_rename")}
          initial={name}
          taken={taken}
          mayOverwrite={false}
          onClose={() => setAsked(null)}
          onSubmit={(next) => edit(next)}
        />
      )}
      {asked === "delete" && (
        <Dialog open onOpenChange={() => setAsked(null)} title={text("arm_delete_title", { name })} description={text("arm_delete_explained")}>
          <div className="flex justify-end gap-3">
            <Button className="h-11" onClick={() => setAsked(null)}>
              {text("cancel")}
            </Button>
            <HoldButton tone="dark" onHeld={() => void edit("").then(() => setAsked(null))}>
              {text("arm_delete_hold")}
            </HoldButton>
          </div>
        </Dialog>
      )}
    </>
  );
}
