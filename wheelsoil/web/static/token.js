// The token stands behind the # of the page's address, and goes in a header of each request, into no address.

export function token() {
  try { return decodeURIComponent(location.hash.slice(1)); } catch { return location.hash.slice(1); }
}

export function headers(more = {}) {
  return token() ? { ...more, Authorization: `Bearer ${token()}` } : more;
}

/** Put what was typed, a token or a whole address, where a token belongs. */
export function takeToken(typed) {
  location.hash = encodeURIComponent(typed.trim().replace(/^.*#/, ""));
}
