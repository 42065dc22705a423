import { RotateCcw } from "lucide-react";
import { type ReactNode, useId, useState } from "react";
import { rosbridgeUrl } from "@/environment";
import type { Settings } from "@/generated/settings";
import { TEXT_KEYS, type Text, type TextKey, useText } from "@/i18n/text";
import { elsewhere } from "@/safety/elsewhere";
import { showProblem } from "@/state/problems";
import { type SettingName, type SettingRow, changeSettings, isShared, isValid, rowOf, useSetting } from "@/state/settings";
import { Button } from "@/ui/button";
import { cn } from "@/ui/cn";
import { Segments } from "@/ui/segments";
import { Switch } from "@/ui/switch";
import { readNumber } from "./groups";

const FIELD = "min-h-10 w-full rounded-md border border-line-strong bg-well px-3 py-2 text-sm max-xl:min-h-11 aria-invalid:border-attention";

/** One setting, with what its values may be. A change is sent when it is complete. */
export function SettingField({ name }: { name: SettingName }) {
  const text = useText();
  const value = useSetting(name);
  const row = rowOf(name);
  const label = text(`setting_${name}`);
  const hint = hintOf(name, text);
  const change = (next: boolean | number | string) => void changeSettings({ [name]: next } as Partial<Settings>).catch(showProblem);
  const reset = value === row.default ? null : <Reset row={row} text={text} onReset={() => change(row.default)} />;

  if (typeof value === "boolean") {
    return (
      <div>
        <Switch label={label} hint={hint} checked={value} onChange={change} />
        {reset}
      </div>
    );
  }
  if (row.choices !== undefined) {
    return (
      <Labelled label={label} hint={hint} reset={reset}>
        <Segments
          label={label}
          value={String(value)}
          options={row.choices.map((choice) => ({ value: choice, label: choiceLabel(choice, text) }))}
          onChange={change}
          className="self-start"
        />
      </Labelled>
    );
  }
  if (typeof value === "number") return <NumberField key={value} label={label} hint={hint} row={row} value={value} reset={reset} onChange={change} />;
  const needsReload = name === "rosUrl" && rosbridgeUrl(value) !== (elsewhere() ?? rosbridgeUrl(null));
  return (
    <>
      <TextField key={value} label={label} hint={hint} long={name === "voiceSystemPrompt"} row={row} value={value} reset={reset} onChange={change} />
      {needsReload && (
        <Button size="small" className="self-start" onClick={() => location.reload()}>
          {text("settings_open_again")}
        </Button>
      )}
    </>
  );
}

function NumberField({
  label,
  hint,
  row,
  value,
  reset,
  onChange,
}: {
  label: string;
  hint: string;
  row: SettingRow;
  value: number;
  reset: ReactNode;
  onChange: (value: number) => void;
}) {
  const text = useText();
  const id = useId();
  const [typed, setTyped] = useState(String(value));
  const read = readNumber(typed, row);
  const { low, high } = row;
  const unit = row.unit === "" ? "" : ` ${row.unit}`;
  const range = low === undefined || high === undefined ? row.unit : text("settings_range", { low, high, unit });
  return (
    <Labelled label={label} hint={hint} htmlFor={id} reset={reset}>
      <div className="flex items-center gap-3">
        <input
          id={id}
          inputMode="decimal"
          value={typed}
          aria-invalid={read === null}
          aria-describedby={`${id}-range`}
          onChange={(event) => setTyped(event.target.value)}
          onBlur={() => read !== null && read !== value && onChange(read)}
          onKeyDown={(event) => {
            if (event.key === "Enter" && read !== null && read !== value) onChange(read);
            if (event.key === "Escape") setTyped(String(value));
          }}
          className={cn(FIELD, "max-w-32 numeric")}
        />
        <span id={`${id}-range`} role={read === null ? "alert" : undefined} className={cn("text-xs", read === null ? "text-attention" : "text-text-3")}>
          {read === null && low !== undefined && high !== undefined ? text("settings_out_of_range", { low, high }) : range}
        </span>
      </div>
    </Labelled>
  );
}

function TextField({
  label,
  hint,
  long,
  row,
  value,
  reset,
  onChange,
}: {
  label: string;
  hint: string;
  long: boolean;
  row: SettingRow;
  value: string;
  reset: ReactNode;
  onChange: (value: string) => void;
}) {
  const id = useId();
  const text = useText();
  const [typed, setTyped] = useState(value);
  const chosen = long ? typed : typed.trim();
  const isAllowed = isValid(chosen, row);
  const common = {
    id,
    value: typed,
    "aria-invalid": !isAllowed,
    spellCheck: long,
    autoCapitalize: "off",
    onChange: (event: { target: { value: string } }) => setTyped(event.target.value),
    onBlur: () => isAllowed && chosen !== value && onChange(chosen),
  };
  return (
    <Labelled label={label} hint={hint} htmlFor={id} reset={reset}>
      {long ? (
        <textarea {...common} rows={4} className={FIELD} />
      ) : (
        <input
          {...common}
          onKeyDown={(event) => {
            if (event.key === "Enter" && isAllowed && chosen !== value) onChange(chosen);
            if (event.key === "Escape") setTyped(value);
          }}
          className={cn(FIELD, "numeric")}
        />
      )}
      {!isAllowed && (
        <span role="alert" className="text-xs text-attention">
          {row.schemes === undefined
            ? text("settings_not_allowed")
            : text("settings_not_an_address", { example: row.schemes.map((scheme) => `${scheme}://10.42.0.1:9090`).join(", ") })}
        </span>
      )}
    </Labelled>
  );
}

function Labelled({
  label,
  hint,
  htmlFor,
  reset,
  children,
}: {
  label: string;
  hint: string;
  htmlFor?: string;
  reset: ReactNode;
  children: ReactNode;
}) {
  const name = (
    <>
      {label}
      <span className="block text-xs text-text-3">{hint}</span>
    </>
  );
  return (
    <div className="flex flex-col gap-1.5 py-1">
      {htmlFor === undefined ? <p>{name}</p> : <label htmlFor={htmlFor}>{name}</label>}
      {children}
      {reset}
    </div>
  );
}

function Reset({ row, text, onReset }: { row: SettingRow; text: Text; onReset: () => void }) {
  return (
    <Button kind="quiet" size="small" onClick={onReset} className="-ml-2 self-start px-2">
      <RotateCcw />
      {text("settings_reset", { value: valueLabel(row.default, text) })}
    </Button>
  );
}

function valueLabel(value: boolean | number | string, text: Text): string {
  if (typeof value === "boolean") return text(value ? "settings_on" : "settings_off");
  return value === "" ? text("settings_empty") : choiceLabel(String(value), text);
}

function choiceLabel(choice: string, text: Text): string {
  const key = `choice_${choice}`;
  return isKey(key) ? text(key) : choice.replace(/^.*\//, "");
}

/** What a setting means, and whom it concerns. */
function hintOf(name: SettingName, text: Text): string {
  const key = `setting_${name}_hint`;
  const holdsFor = text(isShared(name) ? "settings_for_all" : "settings_for_this");
  return isKey(key) ? `${text(key)} · ${holdsFor}` : holdsFor.charAt(0).toUpperCase() + holdsFor.slice(1);
}

function isKey(key: string): key is TextKey {
  return (TEXT_KEYS as readonly string[]).includes(key);
}
