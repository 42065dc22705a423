import createQrCode from "qrcode-generator";
import { useEffect, useMemo, useState } from "react";
import { getJson } from "@/api/http";
import type { Role } from "@/generated/robot";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { CommandLine } from "@/ui/command_line";
import { Dialog } from "@/ui/dialog";
import { Segments } from "@/ui/segments";
import { useOverlayState } from "@/state/overlays";
import { type Access, pairingUrl, sharedUrls } from "./share/access";
import { qrPath } from "./share/qr_path";

/** A used code is replaced, and a network may come and go. */
const PERIOD_MS = 3000;

/** How another device opens this console: its address in the network as a QR code, with a code that pairs the device. */
export default function ShareDialog() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("share");
  const { access, problem } = useAccess(isOpen);
  const [chosen, setChosen] = useState<string | null>(null);
  const [role, setRole] = useState<Role>("operator");
  const urls = access === null ? [] : sharedUrls(access, location);
  const url = chosen !== null && urls.includes(chosen) ? chosen : urls[0];
  const code = access?.codes[role];
  const description = url === undefined ? "" : text(code === undefined ? "share_ask_code" : "share_scan");
  return (
    <Dialog open={isOpen} onOpenChange={setOpen} title={text("share_title")} description={description}>
      <div className="flex flex-col gap-4">
        {code !== undefined && url !== undefined && (
          <Segments
            label={text("share_role")}
            value={role}
            options={[
              { value: "operator", label: text("share_operator") },
              { value: "viewer", label: text("share_viewer") },
            ]}
            onChange={setRole}
            className="self-center"
          />
        )}
        {url !== undefined && (
          <>
            <QrCode content={pairingUrl(url, code)} label={text("share_alt", { url })} />
            <p className="text-center text-base break-all select-all numeric">{url}/</p>
            {code !== undefined && (
              <p className="text-center text-lg">
                <span className="text-sm text-text-2">{text("share_code")} </span>
                <span className="font-semibold select-all numeric" data-testid="pairing-code">
                  {code}
                </span>
              </p>
            )}
            {url.startsWith("https:") && <p className="text-xs text-text-3">{text("share_certificate", { url: `${url}/authority.crt` })}</p>}
          </>
        )}
        {urls.length > 1 && (
          <details>
            <summary className="min-h-11 cursor-pointer py-2 text-text-2">{text("share_elsewhere")}</summary>
            <ul>
              {urls
                .filter((each) => each !== url)
                .map((each) => (
                  <li key={each}>
                    <button type="button" onClick={() => setChosen(each)} className="min-h-11 text-left break-all underline hover:text-sensed numeric">
                      {each}
                    </button>
                  </li>
                ))}
            </ul>
          </details>
        )}
        {access !== null && url === undefined && (
          <div role="status" className="flex flex-col gap-3">
            <p>{text(access.serves_only_this_computer ? "share_loopback" : "share_no_network")}</p>
            {access.serves_only_this_computer && <CommandLine command="lupin up" />}
          </div>
        )}
        {access === null && problem !== "" && (
          <p role="alert" className="text-attention">
            {text("share_unknown", { reason: problem })}
          </p>
        )}
      </div>
    </Dialog>
  );
}

function useAccess(isOpen: boolean): { access: Access | null; problem: string } {
  const [state, setState] = useState<{ access: Access | null; problem: string }>({ access: null, problem: "" });
  useEffect(() => {
    if (!isOpen) return;
    let isOver = false;
    const load = () => {
      getJson<Access>("/_api/access")
        .then((access) => !isOver && setState({ access, problem: "" }))
        .catch((error: unknown) => !isOver && setState({ access: null, problem: errorText(error) }));
    };
    load();
    const timer = setInterval(load, PERIOD_MS);
    return () => {
      isOver = true;
      clearInterval(timer);
    };
  }, [isOpen]);
  return state;
}

function QrCode({ content, label }: { content: string; label: string }) {
  const code = useMemo(() => {
    const made = createQrCode(0, "M");
    made.addData(content);
    made.make();
    return qrPath(made.getModuleCount(), (row, column) => made.isDark(row, column));
  }, [content]);
  return (
    <svg
      viewBox={`0 0 ${code.size} ${code.size}`}
      role="img"
      aria-label={label}
      shapeRendering="crispEdges"
      className="w-full max-w-72 self-center rounded-md bg-white"
    >
      <path d={code.path} fill="#000" />
    </svg>
  );
}
