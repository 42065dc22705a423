import createQrCode from "qrcode-generator";
import { useMemo } from "react";
import { useText } from "@/i18n/text";
import { Dialog } from "@/ui/dialog";
import { useOverlayState } from "./overlays";
import { isLocalHost, qrPath } from "./share/qr_path";

/** The address of this console as a QR code, for a phone. */
export default function ShareDialog() {
  const text = useText();
  const [isOpen, setOpen] = useOverlayState("share");
  const url = `${location.origin}/`;
  const code = useMemo(() => {
    const made = createQrCode(0, "M");
    made.addData(url);
    made.make();
    return qrPath(made.getModuleCount(), (row, column) => made.isDark(row, column));
  }, [url]);
  const isLocal = isLocalHost(location.hostname);
  return (
    <Dialog open={isOpen} onOpenChange={setOpen} title={text("share_title")} description={isLocal ? text("share_local") : text("share_hint")}>
      <div className="flex flex-col items-center gap-4">
        <svg
          viewBox={`0 0 ${code.size} ${code.size}`}
          role="img"
          aria-label={text("share_alt", { url })}
          shapeRendering="crispEdges"
          className="w-full max-w-72 rounded-md bg-white"
        >
          <path d={code.path} fill="#000" />
        </svg>
        <p className="max-w-full text-base break-all select-all numeric">{url}</p>
      </div>
    </Dialog>
  );
}
