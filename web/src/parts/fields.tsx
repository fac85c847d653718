// SPDX-License-Identifier: Apache-2.0
// A form for values that stand in a text.
import { useId, useState } from "preact/hooks";
import type { Field } from "../api/types";

const kUnits = ["mm", "cm", "m", "in", "um"];

interface Input {
  id: string;
  field: Field;
  set: (value: string) => void;
  disabled: boolean;
}

/** The text that is typed, until it is set; follows the value. */
function useTyped(value: string): [string, (typed: string) => void] {
  const [last, setLast] = useState({ value, typed: value });
  if (last.value !== value) setLast({ value, typed: value });
  return [last.value === value ? last.typed : value, (typed) => setLast({ value, typed })];
}

/** "25 mm" -> 25, mm. A length without a unit is in metres, as in the file; words, and what is missing, have none. */
function lengthParts({ value, path }: Field): [string, string] {
  const usual = path.length === 1 ? "mm" : "um"; // of a target, of a pixel
  const [, number, unit] = /^([-+\d.eE]+)\s*(mm|cm|m|in|um)?$/.exec(value) ?? [];
  return number === undefined ? [value, usual] : [number, unit ?? "m"];
}

function Length({ id, field, set, disabled }: Input) {
  const [number, unit] = lengthParts(field);
  const [typed, setTyped] = useTyped(number);
  const [chosen, setChosen] = useTyped(unit);
  const put = (text: string, of: string): void => set(/^[-+\d.eE]+$/.test(text) ? `${text} ${of}` : text);
  return (
    <span class="length">
      <input
        id={id}
        size={7}
        inputMode="decimal"
        placeholder={field.required && field.path.length === 1 ? "25" : ""}
        {...{ disabled, value: typed }}
        onInput={(event) => setTyped(event.currentTarget.value)}
        onChange={() => put(typed.trim(), chosen)}
      />
      <select
        aria-label={`unit of ${labelOf(field)}`}
        {...{ disabled, value: chosen }}
        onChange={(event) => {
          setChosen(event.currentTarget.value);
          if (typed) put(typed.trim(), event.currentTarget.value);
        }}
      >
        {kUnits.map((each) => (
          <option key={each}>{each}</option>
        ))}
      </select>
    </span>
  );
}

function Choice({ id, field: { value, choices }, set, disabled }: Input) {
  return (
    <select {...{ id, disabled, value }} onChange={(event) => set(event.currentTarget.value)}>
      {!choices.includes(value) && <option value={value}>{value || "–"}</option>}
      {choices.map((each) => (
        <option key={each}>{each}</option>
      ))}
    </select>
  );
}

function Text({ id, field, set, disabled }: Input) {
  const [typed, setTyped] = useTyped(field.value);
  return (
    <input
      {...{ id, disabled, value: typed }}
      size={/^\d*$/.test(field.value) ? 5 : 14}
      onInput={(event) => setTyped(event.currentTarget.value)}
      onChange={() => set(typed.trim())}
    />
  );
}

/** "left: model", "square". */
export function labelOf({ path }: Field): string {
  const key = path.at(-1)!.replaceAll("_", " ");
  return path.length > 2 ? `${path[1]}: ${key}` : key;
}

interface Form {
  fields: Field[];
  set: (field: Field, value: string) => void;
  /** Why the fields cannot be changed now. */
  locked: string;
}

export function Fields({ fields, set, locked }: Form) {
  const id = useId();
  if (fields.length === 0) return null;
  return (
    <div class="fields">
      {fields.map((field, i) => {
        const Shown = field.choices.length > 0 ? Choice : field.unit === "m" ? Length : Text;
        return (
          <div key={field.path.join()} class={field.required && !field.value ? "missing" : ""}>
            <label for={`${id}${i}`}>{labelOf(field)}</label>
            <Shown id={`${id}${i}`} field={field} set={(value) => value !== field.value && set(field, value)} disabled={locked !== ""} />
            <small>{field.what}</small>
          </div>
        );
      })}
      {locked && <p class="quiet">{locked}</p>}
    </div>
  );
}
