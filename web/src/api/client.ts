// SPDX-License-Identifier: Apache-2.0
// Requests with the token, which came after '#' in the address and is kept for this tab alone.

const kToken = "plenocal-token";

export function takeToken(): void {
  const found = /[#&]token=([0-9a-f]+)/.exec(location.hash);
  if (!found?.[1]) return;
  sessionStorage.setItem(kToken, found[1]);
  history.replaceState(null, "", location.pathname + "#/setup");
}

function headers(more: Record<string, string> = {}): Record<string, string> {
  return { Authorization: `Bearer ${sessionStorage.getItem(kToken) ?? ""}`, ...more };
}

export class Refused extends Error {
  constructor(
    readonly status: number,
    what: string,
    readonly remedy: string,
  ) {
    super(what);
  }
}

async function refused(answer: Response): Promise<Refused> {
  let what = answer.statusText;
  let remedy = "";
  try {
    const body = (await answer.json()) as { error?: { what?: string; remedy?: string } };
    what = body.error?.what ?? what;
    remedy = body.error?.remedy ?? "";
  } catch {
    // The answer is no JSON: its status has to do.
  }
  return new Refused(answer.status, what, remedy);
}

export async function ask<T>(method: string, path: string, body?: unknown, hash = ""): Promise<T> {
  const options: RequestInit = { method, headers: headers(hash ? { "If-Match": hash } : {}) };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers = { ...options.headers, "Content-Type": "application/json" };
  }
  const answer = await fetch(path, options);
  if (!answer.ok) throw await refused(answer);
  return (await answer.json()) as T;
}

/** A file, as it is. */
export async function send<T>(path: string, file: Blob): Promise<T> {
  const answer = await fetch(path, { method: "POST", body: file, headers: headers({ "Content-Type": "application/octet-stream" }) });
  if (!answer.ok) throw await refused(answer);
  return (await answer.json()) as T;
}

export async function blob(path: string): Promise<Blob> {
  const answer = await fetch(path, { headers: headers() });
  if (!answer.ok) throw await refused(answer);
  return answer.blob();
}

const part = encodeURIComponent;
export const imagePath = (camera: string, frame: string, width: number): string =>
  `/api/image/${part(camera)}/${part(frame)}?w=${width}`;

/** Calls `on` for each event; begins again when the server was away. */
export async function listen(on: (name: string, data: unknown) => void): Promise<void> {
  let last = "";
  for (;;) {
    try {
      const answer = await fetch("/api/events", { headers: headers(last ? { "Last-Event-ID": last } : {}) });
      if (answer.status === 401) return on("refused", null);
      const reader = answer.body?.pipeThrough(new TextDecoderStream()).getReader();
      let text = "";
      while (reader) {
        const { value, done } = await reader.read();
        if (done) break;
        text += value;
        let end = text.indexOf("\n\n");
        for (; end >= 0; end = text.indexOf("\n\n")) {
          const lines = text.slice(0, end).split("\n");
          text = text.slice(end + 2);
          const field = (name: string): string =>
            lines.find((line) => line.startsWith(name + ": "))?.slice(name.length + 2) ?? "";
          if (field("id")) last = field("id");
          if (field("event")) on(field("event"), JSON.parse(field("data") || "null"));
        }
      }
    } catch {
      on("away", null);
    }
    await new Promise((resume) => setTimeout(resume, 1000));
  }
}
