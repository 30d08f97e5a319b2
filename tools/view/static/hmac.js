// HMAC-SHA256 by @noble/hashes: crypto.subtle is missing off loopback without TLS.

import { bytesToHex, hmac as authenticate, sha256, utf8ToBytes } from "./vendor.js";

/**
 * @param {string} key
 * @param {string} message
 * @returns {string} HMAC-SHA256 of both in UTF-8, in lower-case hexadecimal
 */
export function hmac(key, message) {
  return bytesToHex(authenticate(sha256, utf8ToBytes(key), utf8ToBytes(message)));
}
