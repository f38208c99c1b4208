"""Films as MP4 (H.264), encoded by the Chromium that drew them: no other program is needed."""

from __future__ import annotations

import base64

from crux_tools.errors import WorkFailed
from crux_tools.output import progress
from crux_tools.view.browser import open_page

MIME = "video/mp4;codecs=avc1.640028"
BITS_A_S = 8_000_000
# Chromium's recorder dates pictures by the clock: they are shown to it as fast as the film plays.
_RECORDER = f"""
const [width, height, period_ms] = [%d, %d, %g];
const canvas = Object.assign(document.createElement("canvas"), {{ width, height }});
const pen = canvas.getContext("2d"), stream = canvas.captureStream(0), parts = [];
const recorder = new MediaRecorder(stream, {{ mimeType: "{MIME}", videoBitsPerSecond: {BITS_A_S} }});
recorder.ondataavailable = (event) => parts.push(event.data);
document.body.append(canvas); // a canvas that is not shown is not drawn, and gives no pictures
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
let begin = null, shown = 0;
async function show(picture) {{
  const bitmap = await createImageBitmap(await (await fetch("data:image/png;base64," + picture)).blob());
  if (begin !== null) await wait(Math.max(begin + shown * period_ms - performance.now(), 0));
  pen.drawImage(bitmap, 0, 0);
  if (begin === null) {{ // not before: a recorder begins with what the canvas shows, which would be black
    await new Promise(requestAnimationFrame);
    begin = performance.now();
    recorder.start();
  }}
  shown += 1;
  stream.getVideoTracks()[0].requestFrame();
  await new Promise(requestAnimationFrame);
}}
async function finish() {{
  await wait(period_ms);
  await new Promise((done) => {{ recorder.onstop = done; recorder.stop(); }});
  const bytes = new Uint8Array(await new Blob(parts).arrayBuffer());
  let text = "";
  for (let at = 0; at < bytes.length; at += 32768) text += String.fromCharCode(...bytes.subarray(at, at + 32768));
  return btoa(text);
}}
"""


def mp4(pictures: list[bytes], size_px: tuple[int, int], frames_a_s: float) -> bytes:
    """The PNG `pictures` as a film. Raises WorkFailed without Chromium, or where it has no H.264."""
    with open_page("about:blank", size_px) as page, progress("encoding", len(pictures)) as bar:
        if not page.value(f"typeof MediaRecorder !== 'undefined' && MediaRecorder.isTypeSupported('{MIME}')"):
            raise WorkFailed("this Chromium encodes no MP4 (H.264): choose a name that ends in .webp or .gif")
        page.value(_RECORDER % (*size_px, 1000 / frames_a_s))
        for i, picture in enumerate(pictures):
            page.value(f"show('{base64.b64encode(picture).decode()}')")
            bar.at(i)
        return base64.b64decode(page.value("finish()"))
