import { useText } from "@/i18n/text";
import { usePublishLog } from "@/state/publish_log";
import { Button } from "@/ui/button";
import { timeOfDay } from "@/ui/numbers";

/** What this page sent last, the newest first. */
export function PublishLog() {
  const text = useText();
  const publications = usePublishLog((state) => state.publications);
  return (
    <section aria-label={text("settings_log")} className="flex flex-col gap-2">
      <div className="flex items-center gap-3">
        <h3 className="grow text-sm font-semibold text-text-2">{text("settings_log")}</h3>
        {publications.length > 0 && (
          <Button kind="quiet" size="small" onClick={() => usePublishLog.setState({ publications: [] })}>
            {text("settings_log_clear")}
          </Button>
        )}
      </div>
      {publications.length === 0 ? (
        <p className="text-text-3">{text("settings_log_empty")}</p>
      ) : (
        <ol className="max-h-64 overflow-y-auto rounded-md bg-well">
          {publications.map(({ number, topic, text: message, sent, time }) => (
            <li key={number} className="border-b border-line px-3 py-1.5 text-xs last:border-b-0">
              <p className="flex gap-2">
                <span className="text-text-3 numeric">{timeOfDay(time)}</span>
                <span className="min-w-0 truncate font-semibold numeric">{topic}</span>
                {!sent && <span className="ml-auto shrink-0 text-attention">{text("settings_log_not_sent")}</span>}
              </p>
              <p className="truncate text-text-2 numeric">{message}</p>
            </li>
          ))}
        </ol>
      )}
    </section>
  );
}
