// SPDX-License-Identifier: Apache-2.0
// Suggested views of the run that is shown.
import { computed, effect, signal } from "@preact/signals";
import { ask } from "../api/client";
import type { Suggestions } from "../api/types";
import { attempt, renewed, run } from "./project";

const found = signal<{ of: unknown; suggestions: Suggestions } | null>(null);

/** Those found last: while new ones are looked for, they stay. */
export const lastSuggestions = computed(() => found.value?.suggestions ?? null);

// Suggestions renewed with pictures that the run does not have yet belong to no run.
effect(() => {
  if (renewed.value) found.value = { of: null, suggestions: renewed.value };
});

/** Of this very result: a run that is made again has others. */
export const suggestionsOfRun = (): Suggestions | null => (found.value && found.value.of === run.value ? found.value.suggestions : null);

/** Null where there are none, which is shown. An answer does not replace suggestions that were renewed meanwhile. */
export async function findSuggestions(): Promise<Suggestions | null> {
  const of = run.value;
  if (!of || found.value?.of === of) return suggestionsOfRun();
  const before = renewed.value;
  let suggestions: Suggestions | null = null;
  await attempt(async () => {
    suggestions = await ask<Suggestions>("POST", "/api/suggest", { run: of.run, count: 5 });
    if (run.value === of && renewed.value === before) found.value = { of, suggestions };
  });
  return suggestions;
}
