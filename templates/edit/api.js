// What the page asks of the server, with the token that the address brought; and its events.

const KEPT = "physgen-token";
const address = new URL(location.href);
if (address.searchParams.has("token")) {
  sessionStorage.setItem(KEPT, address.searchParams.get("token"));
  address.searchParams.delete("token");
  history.replaceState(null, "", address);
}
const token = sessionStorage.getItem(KEPT) || "";
const headers = { "X-Physgen-Token": token };

// An answer that is no: `status`, 0 where no server answers, and the `body` that says why.
export class Refused extends Error {
  constructor(status, body) {
    const { message, fix } = body?.error || {};
    super([message || `the server answered ${status}`, fix].filter(Boolean).join("; "));
    this.status = status;
    this.body = body || {};
  }
}

async function answered(path, options) {
  let response;
  try {
    response = await fetch(path, { ...options, cache: "no-store" });
  } catch {
    throw new Refused(0, { error: { message: "the editor's server does not answer", fix: "start `physgen edit` again: nothing is lost" } });
  }
  if (!response.ok) throw new Refused(response.status, await response.json().catch(() => null));
  return response;
}

// method and path, a body as JSON -> the answer
export async function ask(method, path, body) {
  const sent = body === undefined ? { headers } : { headers: { ...headers, "Content-Type": "application/json" }, body: JSON.stringify(body) };
  return (await answered(path, { method, ...sent })).json();
}

// a picture -> the address of its bytes in this window
export async function picture(path) {
  return URL.createObjectURL(await (await answered(path, { headers })).blob());
}

// What happens, asked for again and again as long as the page is open; `lost` and `found` when the server goes and comes
// back. Not a stream that is held open: of those a browser has six for all windows together.
const EVERY = 300, HIDDEN = 2000; // ms
const news = (run, since) => ask("GET", `/api/events?run=${run}&since=${since}`);

// Where the news begin: what comes after this goes to the listener that it returns, what came before is in the state.
export async function beginning() {
  let { run, next: since } = await news("", 0), there = true;
  return async function listen(hear) {
    for (;;) {
      await new Promise((done) => {
        const soon = setTimeout(done, document.visibilityState === "hidden" ? HIDDEN : EVERY);
        document.addEventListener("visibilitychange", () => { clearTimeout(soon); done(); }, { once: true });
      });
      try {
        const found = await news(run, since);
        if (!there) hear({ type: "found" });
        [there, run, since] = [true, found.run, found.next];
        found.events.forEach(hear);
      } catch (refused) {
        if (refused.status === undefined) throw refused;
        if (there) { there = false; hear({ type: "lost" }); }
        if (refused.status === 401) return; // another server: the page does not know its token
      }
    }
  };
}
