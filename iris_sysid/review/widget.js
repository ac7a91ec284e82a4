// The review in a notebook: markup and style in a shadow root, messages to the kernel as the way to the server.

const PATIENCE_MS = 60000;

function serverOf(model) {
  const waiting = new Map();
  const view = Math.random().toString(36).slice(2); // several views of one widget get each other's answers
  let count = 0;
  const answered = ({ id, status, type }, [body]) => {
    waiting.get(id)?.({ status, body: new Blob([body], { type }) });
    waiting.delete(id);
  };
  model.on("msg:custom", answered);
  const ask = (path, content) =>
    new Promise((done, fail) => {
      const id = `${view}-${++count}`;
      const late = "The kernel does not answer: it is busy, or has ended. Every edit it took is in the log.";
      const timer = setTimeout(() => (waiting.delete(id), fail(new Error(late))), PATIENCE_MS);
      waiting.set(id, (answer) => (clearTimeout(timer), done(answer)));
      model.send(content === undefined ? { id, path } : { id, path, content });
    });
  return { ask, end: () => model.off("msg:custom", answered) };
}

async function render({ model, el }) {
  const host = document.createElement("div");
  host.dataset.lmSuppressShortcuts = "true"; // the keys are the review's, not the notebook's
  host.addEventListener("keydown", (event) => event.stopPropagation());
  const light = document.body.dataset.jpThemeLight; // of JupyterLab; other notebooks go with the system
  if (light) host.dataset.dark = String(light === "false");
  const root = host.attachShadow({ mode: "open" });
  root.innerHTML = `<style>${model.get("_style")}</style>${model.get("_markup")}`;
  el.append(host);
  const address = URL.createObjectURL(new Blob([model.get("_module")], { type: "text/javascript" }));
  const { open } = await import(address); // a module of its own for each view
  URL.revokeObjectURL(address);
  const server = serverOf(model);
  const close = open(root, host, server.ask);
  return () => (close(), server.end());
}

export default { render };
