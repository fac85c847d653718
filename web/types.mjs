// SPDX-License-Identifier: Apache-2.0
// TypeScript of a JSON schema: an interface or a type for each of its `$defs`.

const kTuple = 3; // longer lists of fixed length are lists
const comment = ({ description }, indent) => (description ? `${indent}/** ${description} */\n` : "");
const name = (ref) => ref.split("/").at(-1);

function listOf(schema, indent) {
  const { items, prefixItems, minItems, maxItems } = schema;
  const fixed = prefixItems ?? (minItems === maxItems && minItems <= kTuple ? Array(minItems).fill(items) : null);
  if (fixed) return `[${fixed.map((each) => typeOf(each, indent)).join(", ")}]`;
  const element = typeOf(items, indent);
  return /[|&]/.test(element) ? `(${element})[]` : `${element}[]`;
}

function membersOf({ properties, required = [] }, indent) {
  const inner = `${indent}  `;
  const lines = Object.entries(properties).map(
    ([key, schema]) => `${comment(schema, inner)}${inner}${key}${required.includes(key) ? "" : "?"}: ${typeOf(schema, inner)};\n`,
  );
  return `{\n${lines.join("")}${indent}}`;
}

function typeOf(schema, indent = "") {
  if (schema.$ref) return name(schema.$ref);
  if (schema.anyOf) return schema.anyOf.map((each) => typeOf(each, indent)).join(" | ");
  if (schema.allOf) return schema.allOf.map((each) => typeOf(each, indent)).join(" & ");
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(" | ");
  if (schema.const !== undefined) return JSON.stringify(schema.const);
  if (Array.isArray(schema.type)) return schema.type.map((type) => typeOf({ ...schema, type }, indent)).join(" | ");
  if (schema.type === "array") return listOf(schema, indent);
  if (schema.properties) return membersOf(schema, indent);
  if (schema.additionalProperties) return `Record<string, ${typeOf(schema.additionalProperties, indent)}>`;
  return schema.type === "integer" ? "number" : schema.type;
}

export function typesOf({ $defs }, source) {
  const types = Object.entries($defs).map(([key, schema]) => {
    const bases = schema.properties && schema.allOf ? ` extends ${schema.allOf.map(({ $ref }) => name($ref)).join(", ")}` : "";
    const body = schema.properties ? `interface ${key}${bases} ${membersOf(schema, "")}` : `type ${key} = ${typeOf(schema)};`;
    return `${comment(schema, "")}export ${body}\n`;
  });
  return `// Made from ${source} by web/types.mjs.\n\n${types.join("\n")}`;
}
