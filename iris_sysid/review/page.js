// The page of a review: its module, with fetch as the way to the server that knows the token.

const token = document.querySelector('meta[name="token"]').content;
const { open } = await import(`./review.js?token=${encodeURIComponent(token)}`);

async function server(path, content) {
  const options = { headers: { "x-review-token": token } };
  if (content !== undefined) {
    options.method = "POST";
    options.headers["content-type"] = "application/json";
    options.body = JSON.stringify(content);
  }
  let answer;
  try {
    answer = await fetch(`.${path}`, options);
  } catch {
    throw new Error("The server has ended. Every edit is in the log: start the review again.");
  }
  return { status: answer.status, body: await answer.blob() };
}

open(document, document.documentElement, server);
