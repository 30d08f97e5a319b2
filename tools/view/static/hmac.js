// HMAC-SHA256 in plain JavaScript: crypto.subtle is missing off loopback without TLS.
// FIPS 180-4 and RFC 2104; a test compares it with Python's hmac.

const BLOCK = 64; // bytes

/** Fractional parts of the square or cube roots of the first primes, as 32-bit words. */
function roots(count, power) {
  const words = [];
  for (let n = 2; words.length < count; n += 1) {
    let prime = true;
    for (let d = 2; d * d <= n; d += 1) prime &&= n % d !== 0;
    if (prime) words.push(Math.floor((n ** power % 1) * 2 ** 32));
  }
  return words;
}
const START = roots(8, 1 / 2);
const ROUNDS = roots(64, 1 / 3);

const turn = (word, by) => (word >>> by) | (word << (32 - by));

/**
 * @param {Uint8Array} message
 * @returns {Uint8Array} 32 bytes
 */
export function sha256(message) {
  const padded = new Uint8Array(Math.ceil((message.length + 9) / BLOCK) * BLOCK);
  padded.set(message);
  padded[message.length] = 0x80;
  const view = new DataView(padded.buffer);
  view.setUint32(padded.length - 8, Math.floor(message.length / 2 ** 29));
  view.setUint32(padded.length - 4, message.length << 3);

  const state = Int32Array.from(START);
  const w = new Int32Array(64);
  for (let at = 0; at < padded.length; at += BLOCK) {
    for (let i = 0; i < 16; i += 1) w[i] = view.getInt32(at + 4 * i);
    for (let i = 16; i < 64; i += 1) {
      const s0 = turn(w[i - 15], 7) ^ turn(w[i - 15], 18) ^ (w[i - 15] >>> 3);
      const s1 = turn(w[i - 2], 17) ^ turn(w[i - 2], 19) ^ (w[i - 2] >>> 10);
      w[i] = w[i - 16] + s0 + w[i - 7] + s1;
    }
    let [a, b, c, d, e, f, g, h] = state;
    for (let i = 0; i < 64; i += 1) {
      const mixed = turn(e, 6) ^ turn(e, 11) ^ turn(e, 25);
      const t1 = (h + mixed + ((e & f) ^ (~e & g)) + ROUNDS[i] + w[i]) | 0;
      const t2 = ((turn(a, 2) ^ turn(a, 13) ^ turn(a, 22)) + ((a & b) ^ (a & c) ^ (b & c))) | 0;
      [h, g, f, e, d, c, b, a] = [g, f, e, (d + t1) | 0, c, b, a, (t1 + t2) | 0];
    }
    [a, b, c, d, e, f, g, h].forEach((word, i) => (state[i] += word));
  }
  const digest = new DataView(new ArrayBuffer(32));
  state.forEach((word, i) => digest.setInt32(4 * i, word));
  return new Uint8Array(digest.buffer);
}

/** @returns {Uint8Array} both, one after the other */
function joined(first, second) {
  const all = new Uint8Array(first.length + second.length);
  all.set(first);
  all.set(second, first.length);
  return all;
}

/**
 * @param {string} key
 * @param {string} message
 * @returns {string} HMAC-SHA256 of both in UTF-8, in lower-case hexadecimal
 */
export function hmac(key, message) {
  const text = new TextEncoder();
  let secret = text.encode(key);
  if (secret.length > BLOCK) secret = sha256(secret);
  const pad = (byte) => {
    const block = new Uint8Array(BLOCK).fill(byte);
    secret.forEach((each, i) => (block[i] ^= each));
    return block;
  };
  const inner = sha256(joined(pad(0x36), text.encode(message)));
  const digest = sha256(joined(pad(0x5c), inner));
  return Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
}
