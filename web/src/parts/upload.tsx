// SPDX-License-Identifier: Apache-2.0
// Images of this machine's browser into the folder of the workbench: chosen, or dropped with their folders. Where there is a
// session, they become images of its cameras.
import { useState } from "preact/hooks";
import { send } from "../api/client";
import type { SessionCamera } from "../api/types";

interface Chosen {
  folder: string; // the last one of its path; "" for a file alone
  file: File;
}

const folderOf = (path: string): string => path.split("/").at(-2) ?? "";

/** Files of dropped entries, those of folders with all below. */
async function entriesOf(entry: FileSystemEntry, folder: string): Promise<Chosen[]> {
  if (entry.isFile) {
    const file = await new Promise<File>((take, fail) => (entry as FileSystemFileEntry).file(take, fail));
    return [{ folder, file }];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const chosen: Chosen[] = [];
  for (;;) {
    // A browser gives a hundred at a time.
    const some = await new Promise<FileSystemEntry[]>((take, fail) => reader.readEntries(take, fail));
    if (some.length === 0) return chosen;
    for (const each of some) chosen.push(...(await entriesOf(each, entry.name)));
  }
}

/** `done` is called after all files were taken or refused. */
export function Upload({ done, cameras = [] }: { done: () => void; cameras?: SessionCamera[] }) {
  const [camera, setCamera] = useState("");
  const chosenCamera = cameras.find(({ name }) => name === camera)?.name ?? cameras[0]?.name;
  // A folder that is named like a camera, or like its folder, has the images of this one.
  const placeOf = (folder: string): Record<string, string> =>
    chosenCamera === undefined
      ? { dir: folder }
      : { camera: cameras.find((each) => folder && [each.name, each.folder].includes(folder))?.name ?? chosenCamera };
  const [state, setState] = useState("");
  const [refused, setRefused] = useState<string[]>([]);
  const take = async (chosen: Chosen[]) => {
    const problems: string[] = [];
    let count = 0;
    for (const { folder, file } of chosen) {
      setState(`${count} of ${chosen.length} files are in the folder`);
      try {
        await send(`/api/files?${new URLSearchParams({ ...placeOf(folder), name: file.name })}`, file);
        ++count;
      } catch (error) {
        problems.push(error instanceof Error ? error.message : String(error));
      }
    }
    setState(`${count} of ${chosen.length} files are in the folder`);
    setRefused(problems);
    done();
  };
  const onFiles = async ({ currentTarget: input }: { currentTarget: HTMLInputElement }) => {
    await take([...(input.files ?? [])].map((file) => ({ folder: folderOf(file.webkitRelativePath), file })));
    input.value = ""; // the same files can be chosen again
  };
  const onDrop = async (event: DragEvent) => {
    event.preventDefault();
    // Entries are there only until the first wait.
    const entries = [...(event.dataTransfer?.items ?? [])].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
    const chosen = await Promise.all(entries.map((entry) => entriesOf(entry, "")));
    await take(chosen.flat());
  };
  return (
    <section class="drop" onDragOver={(event) => event.preventDefault()} onDrop={onDrop}>
      <h2>Add images</h2>
      <p>Drop images here, or folders, one for each camera. They are copied; nothing is replaced.</p>
      <div class="row">
        {cameras.length > 0 && (
          <label>
            images of{" "}
            <select value={chosenCamera} onChange={(event) => setCamera(event.currentTarget.value)}>
              {cameras.map(({ name }) => (
                <option key={name}>{name}</option>
              ))}
            </select>
          </label>
        )}
        <label>
          images or recordings <input type="file" multiple onChange={onFiles} />
        </label>
        <label>
          a camera's folder <input type="file" {...{ webkitdirectory: true }} onChange={onFiles} />
        </label>
      </div>
      <p aria-live="polite">{state}</p>
      {refused.length > 0 && (
        <details open={refused.length < 6}>
          <summary class="bad">{refused.length} left out</summary>
          <ul>
            {refused.map((why) => (
              <li key={why}>{why}</li>
            ))}
          </ul>
        </details>
      )}
    </section>
  );
}
