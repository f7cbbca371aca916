// A reader would have to search all methods for what an object has.

import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { test } from "node:test";

const FOLDER = new URL("../../../gcs/console/static/", import.meta.url);
const CLASS = /^(?:export )?class (\w+).*?^\}/gms;
const METHOD = /^ {2}(?:async )?(?:[gs]et )?(\w+)\(.*?^ {2}\}/gms;
const FIELD = /\bthis\.(\w+)(?: =|\?\?=| \?\?=) /g;

/** @param {string} text */
const fieldsIn = (text) => [...text.matchAll(FIELD)].map((found) => found[1]);

test("every field is created in the constructor", () => {
  const late = [];
  for (const file of readdirSync(FOLDER).filter((name) => name.endsWith(".js"))) {
    for (const [body, name] of readFileSync(new URL(file, FOLDER), "utf8").matchAll(CLASS)) {
      const methods = [...body.matchAll(METHOD)].map(([text, method]) => ({
        method,
        fields: fieldsIn(text),
      }));
      const created = new Set(methods.find(({ method }) => method === "constructor")?.fields);
      for (const { method, fields } of methods) {
        for (const field of fields)
          if (!created.has(field)) late.push(`${file}: ${name}.${method}: ${field}`);
      }
    }
  }
  assert.deepEqual(late, []);
});
