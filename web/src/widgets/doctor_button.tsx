import { Stethoscope } from "lucide-react";
import { useText } from "@/i18n/text";
import { Button } from "@/ui/button";
import { examine } from "@/api/doctor";
import { showOverlay } from "@/state/overlays";

/** A button that starts the doctor, shown where data is missing. */
export function DoctorButton({ size = "medium" }: { size?: "small" | "medium" }) {
  const text = useText();
  return (
    <Button
      size={size}
      onClick={() => {
        showOverlay("doctor");
        void examine();
      }}
    >
      <Stethoscope />
      {text("run_doctor")}
    </Button>
  );
}
