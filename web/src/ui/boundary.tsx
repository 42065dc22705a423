import { TriangleAlert } from "lucide-react";
import { Component, type ComponentType, type ReactNode } from "react";
import { errorText } from "@/i18n/error_text";
import { useText } from "@/i18n/text";
import { Button } from "./button";
import { renewFailedParts } from "./deferred";

export interface FallbackProps {
  reason: string;
  onRetry: () => void;
}

interface BoundaryProps {
  children: ReactNode;
  /** What is shown instead of children that failed. */
  fallback?: ComponentType<FallbackProps>;
  onFailure?: () => void;
}

/** Keeps a failure of one part of the page from the other parts, and from the stop above all. */
export class Boundary extends Component<BoundaryProps, { reason: string | null }> {
  override state = { reason: null };
  constructor(props: BoundaryProps) {
    super(props);
    renewFailedParts();
  }
  static getDerivedStateFromError(error: unknown) {
    return { reason: errorText(error) };
  }
  private readonly retry = () => {
    renewFailedParts();
    this.setState({ reason: null });
  };
  override componentDidCatch() {
    this.props.onFailure?.();
  }
  override render() {
    const { reason } = this.state;
    const { children, fallback: Fallback = PartFailed } = this.props;
    return reason === null ? children : <Fallback reason={reason} onRetry={this.retry} />;
  }
}

export function PartFailed({ reason, onRetry }: FallbackProps) {
  const text = useText();
  return (
    <div role="alert" className="panel flex max-w-xl flex-col items-start gap-3 p-5">
      <p className="flex items-center gap-2 font-semibold text-attention">
        <TriangleAlert aria-hidden="true" className="size-5 shrink-0" />
        {text("part_failed")}
      </p>
      <p className="text-sm break-words text-text-2">{reason.slice(0, 300)}</p>
      <p className="text-sm text-text-2">{text("part_failed_hint")}</p>
      <div className="flex flex-wrap gap-2">
        <Button onClick={onRetry}>{text("part_retry")}</Button>
        <Button onClick={() => location.reload()}>{text("part_reload")}</Button>
      </div>
    </div>
  );
}
