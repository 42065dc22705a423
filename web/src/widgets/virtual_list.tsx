import { type ReactNode, useEffect, useLayoutEffect, useRef, useState } from "react";
import { cn } from "@/ui/cn";

interface VirtualListProps<Item> {
  label: string;
  items: readonly Item[];
  /** Rises with the items; where a list loses its oldest items, it keeps the rest in place. */
  idOf: (item: Item) => number;
  itemHeight: number;
  render: (item: Item) => ReactNode;
  /** Whether the end stays in view as items are added. */
  isFollowing: boolean;
  /** Called when the operator scrolls to the end or away from it. */
  onFollow: (isFollowing: boolean) => void;
  className?: string;
}

const OVERSCAN = 6;
const NEAR_END_PX = 24;

/** A long list of items of equal height, of which only those in view are in the document. */
export function VirtualList<Item>({ label, items, idOf, itemHeight, render, isFollowing, onFollow, className }: VirtualListProps<Item>) {
  const frame = useRef<HTMLDivElement>(null);
  const anchor = useRef<{ id: number; offset: number } | null>(null);
  const [top, setTop] = useState(0);
  const [height, setHeight] = useState(0);

  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    const observer = new ResizeObserver(() => setHeight(element.clientHeight));
    observer.observe(element);
    return () => observer.disconnect();
  }, []);

  useLayoutEffect(() => {
    const element = frame.current;
    if (element === null) return;
    if (isFollowing && height > 0) element.scrollTop = element.scrollHeight;
    else if (!isFollowing && anchor.current !== null) {
      const { id, offset } = anchor.current;
      const place = items.findIndex((item) => idOf(item) >= id);
      if (place >= 0) element.scrollTop = place * itemHeight + offset;
    }
  }, [items, idOf, itemHeight, isFollowing, height]);

  function onScroll(): void {
    const element = frame.current;
    if (element === null) return;
    setTop(element.scrollTop);
    const first = items[Math.floor(element.scrollTop / itemHeight)];
    anchor.current = first === undefined ? null : { id: idOf(first), offset: element.scrollTop % itemHeight };
  }

  /** Only the operator's own scrolling begins or ends following. */
  function onOperatorScroll(): void {
    requestAnimationFrame(() => {
      const element = frame.current;
      if (element === null) return;
      const isAtEnd = element.scrollHeight - element.scrollTop - element.clientHeight < NEAR_END_PX;
      if (isAtEnd !== isFollowing) onFollow(isAtEnd);
    });
  }

  const from = Math.max(0, Math.floor(top / itemHeight) - OVERSCAN);
  const to = Math.min(items.length, Math.ceil((top + height) / itemHeight) + OVERSCAN);
  return (
    <div
      ref={frame}
      role="region"
      aria-label={label}
      onScroll={onScroll}
      onWheel={onOperatorScroll}
      onTouchMove={onOperatorScroll}
      onPointerUp={onOperatorScroll}
      onKeyDown={onOperatorScroll}
      className={cn("overflow-y-auto", className)}
    >
      <ul className="relative" style={{ height: items.length * itemHeight }}>
        {items.slice(from, to).map((item, index) => (
          <li key={idOf(item)} className="absolute inset-x-0" style={{ top: (from + index) * itemHeight, height: itemHeight }}>
            {render(item)}
          </li>
        ))}
      </ul>
    </div>
  );
}
