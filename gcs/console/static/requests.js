// Requests to the server with JSON as content, and their errors.

/** @import { ErrorReply } from "../page_types.d.ts" */

/**
 * Send an object as JSON.
 *
 * @param {string} path
 * @param {object} content
 * @param {AbortSignal} [signal]
 */
export function post(path, content, signal) {
  return fetch(path, {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify(content),
    signal,
  });
}

/**
 * Return why a request was refused.
 *
 * @param {Response} reply
 */
export async function errorOf(reply) {
  /** @type {ErrorReply} */
  const { error } = await reply.json();
  return error;
}
