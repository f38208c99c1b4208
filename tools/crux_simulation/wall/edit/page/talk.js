// What the page asks its server, and sends to it. Raises Error with the server's words.
async function answered(request) {
  let answer;
  try {
    answer = await request;
  } catch {
    throw new Error("The editor has ended: start crux wall edit again. Nothing more can be saved from this page.");
  }
  if (!answer.ok) throw new Error(await answer.text());
  return answer.json();
}

export const ask = (path) => answered(fetch("." + path));

let session = ""; // of the server that this page is from
export const belong = (name) => { session = name; };

export const send = (path, content) => answered(fetch("." + path,
  { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ session, ...content }) }));
