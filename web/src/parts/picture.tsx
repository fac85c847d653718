// SPDX-License-Identifier: Apache-2.0
// An image of the session, fetched when it comes into view.
import { useEffect, useRef, useState } from "preact/hooks";
import { blob, imagePath } from "../api/client";

const kept = new Map<string, string>();

export function usePicture(path: string, wanted: boolean): string | null {
  const [url, setUrl] = useState<string | null>(kept.get(path) ?? null);
  useEffect(() => {
    let current = true;
    const known = kept.get(path) ?? null;
    setUrl(known);
    if (!wanted || known) return;
    blob(path)
      .then((content) => {
        const made = URL.createObjectURL(content);
        kept.set(path, made);
        if (current) setUrl(made);
      })
      .catch(() => setUrl(null));
    return () => {
      current = false;
    };
  }, [path, wanted]);
  return url;
}

/** The same, decoded. */
export function useImage(path: string): HTMLImageElement | null {
  const [image, setImage] = useState<HTMLImageElement | null>(null);
  const url = usePicture(path, true);
  useEffect(() => {
    setImage(null);
    if (!url) return;
    const made = new Image();
    made.onload = () => setImage(made);
    made.src = url;
  }, [url]);
  return image;
}

export function Thumb({ camera, frame }: { camera: string; frame: string }) {
  const box = useRef<HTMLDivElement>(null);
  const [seen, setSeen] = useState(false);
  useEffect(() => {
    if (!box.current) return;
    const watch = new IntersectionObserver((entries) => {
      if (entries.some((entry) => entry.isIntersecting)) setSeen(true);
    });
    watch.observe(box.current);
    return () => watch.disconnect();
  }, []);
  const url = usePicture(imagePath(camera, frame, 240), seen);
  return (
    <div ref={box} class="thumb">
      {url && <img src={url} alt={`${camera} ${frame}`} />}
    </div>
  );
}
