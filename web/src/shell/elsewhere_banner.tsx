import { Cast } from "lucide-react";
import { ROS_QUERY, rosbridgeUrl } from "@/environment";
import { useText } from "@/i18n/text";
import { elsewhere } from "@/safety/elsewhere";
import { showProblem } from "@/state/problems";
import { changeSettings, setting } from "@/state/settings";
import { Button } from "@/ui/button";

/** Says that the page shows another robot than its console's, or why it does not although it was asked to. */
export function ElsewhereBanner() {
  const text = useText();
  const asked = ROS_QUERY ?? setting("rosUrl");
  const address = elsewhere();
  const isRefused = asked !== "" && rosbridgeUrl(asked) === rosbridgeUrl(null) && !isOwn(asked);
  if (address === null && !isRefused) return null;
  return (
    <div role="status" data-testid="elsewhere" className="flex min-h-12 shrink-0 flex-wrap items-center gap-x-4 gap-y-2 border-b border-line-strong bg-raised px-4 py-2">
      <Cast aria-hidden="true" className="size-5 shrink-0 text-attention" />
      <p className="min-w-0 grow basis-60 wrap-anywhere">
        <strong className="font-semibold">{address === null ? text("elsewhere_refused", { address: asked }) : text("elsewhere_shown", { address })}</strong>
        <span className="block text-xs text-text-2">{text(address === null ? "elsewhere_refused_hint" : "elsewhere_explained")}</span>
      </p>
      <Button onClick={() => void goBack()}>{text("elsewhere_back")}</Button>
    </div>
  );
}

function isOwn(asked: string): boolean {
  return URL.canParse(asked) && new URL(asked).href === new URL(rosbridgeUrl(null)).href;
}

/** Open the page again, on its console's rosbridge. */
async function goBack(): Promise<void> {
  try {
    await changeSettings({ rosUrl: "" });
  } catch (error) {
    showProblem(error);
  }
  const here = new URL(location.href);
  here.searchParams.delete("ros");
  location.replace(here);
}
