"use strict";

// What a browser alone can do: exposure without a reload, values under the pointer, and what happens as
// it happens. Pixels come as 32-bit floats, three each, in units of white.

/** An sRGB code of a linear value, IEC 61966-2-1. */
function encoded(linear) {
  const value = Math.min(1, Math.max(0, linear));
  return value <= 0.0031308 ? 12.92 * value : 1.055 * Math.pow(value, 1 / 2.4) - 0.055;
}

/** Draws pixels, brightened by so many stops. */
function develop(context, pixels, stops) {
  const { width, height } = context.canvas;
  const picture = context.createImageData(width, height);
  const gain = Math.pow(2, stops);
  for (let index = 0; index < width * height; index++) {
    for (let channel = 0; channel < 3; channel++) {
      picture.data[4 * index + channel] = 255 * encoded(gain * pixels[3 * index + channel]) + 0.5;
    }
    picture.data[4 * index + 3] = 255;
  }
  context.putImageData(picture, 0, 0);
}

/** A number with four significant digits. */
function significant(value) {
  return Number(value.toPrecision(4)).toString();
}

/** Replaces the picture by a canvas whose exposure and values need no server. */
async function view(image) {
  const answer = await fetch(image.dataset.pixels);
  if (!answer.ok) {
    return;
  }
  const pixels = new DataView(await answer.arrayBuffer());
  const values = new Float32Array(pixels.byteLength / 4);
  for (let index = 0; index < values.length; index++) {
    values[index] = pixels.getFloat32(4 * index, true);
  }
  const canvas = document.createElement("canvas");
  canvas.width = Number(image.getAttribute("width"));
  canvas.height = Number(image.getAttribute("height"));
  canvas.id = image.id;
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", image.alt + ". Arrow keys move the point whose value is shown.");
  const context = canvas.getContext("2d");
  const slider = document.getElementById("stops");
  const shown = document.getElementById("stops-shown");
  const told = document.getElementById("values");
  const draw = () => {
    shown.value = slider.value;
    develop(context, values, Number(slider.value));
  };
  const point = { column: Math.floor(canvas.width / 2), row: Math.floor(canvas.height / 2) };
  const tell = () => {
    const at = 3 * (point.row * canvas.width + point.column);
    const [r, g, b] = values.subarray(at, at + 3);
    const luminance = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    told.textContent =
      `Column ${point.column}, row ${point.row}: red ${significant(r)}, green ${significant(g)}, ` +
      `blue ${significant(b)} (linear Rec.709, 1 is white); luminance ${significant(luminance)} of white`;
  };
  canvas.addEventListener("pointermove", (event) => {
    const box = canvas.getBoundingClientRect();
    const inside = (share, count) => Math.min(count - 1, Math.max(0, Math.floor(share * count)));
    point.column = inside((event.clientX - box.left) / box.width, canvas.width);
    point.row = inside((event.clientY - box.top) / box.height, canvas.height);
    tell();
  });
  canvas.addEventListener("keydown", (event) => {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const step = steps[event.key];
    if (!step) {
      return;
    }
    event.preventDefault();
    const times = event.shiftKey ? 10 : 1;
    point.column = Math.min(canvas.width - 1, Math.max(0, point.column + times * step[0]));
    point.row = Math.min(canvas.height - 1, Math.max(0, point.row + times * step[1]));
    tell();
  });
  slider.addEventListener("input", draw);
  slider.form.querySelector("button").hidden = true;
  draw();
  image.replaceWith(canvas);
}

/** Empty fields say nothing: they are left out of the address. */
function shorten(form) {
  form.addEventListener("formdata", (event) => {
    for (const [name, value] of [...event.formData.entries()]) {
      if (value === "") {
        event.formData.delete(name);
      }
    }
  });
}

/** Puts new HTML into a section, and keeps the focus where it was. */
function renew(section, html) {
  const focused = section.contains(document.activeElement) ? document.activeElement : null;
  const address = focused && focused.getAttribute("href");
  section.innerHTML = html;
  if (address) {
    const links = [...section.querySelectorAll("a[href]")];
    links.find((link) => link.getAttribute("href") === address)?.focus({ preventScroll: true });
  }
}

/** Keeps the sections of the page as the server says they are. */
function follow(sections) {
  const lost = document.getElementById("connection");
  const source = new EventSource("/live");
  // The server ends each stream after a while, and the browser asks again: that is no trouble yet.
  let patience = null;
  const found = () => {
    clearTimeout(patience);
    patience = null;
    lost.hidden = true;
  };
  source.addEventListener("open", found);
  for (const section of sections) {
    source.addEventListener(section.dataset.live, (event) => renew(section, event.data));
  }
  source.addEventListener("error", () => {
    patience ??= setTimeout(() => {
      lost.hidden = false;
    }, 3500);
    if (source.readyState !== EventSource.CLOSED) {
      // The browser tries again by itself.
      return;
    }
    // The server answered, but not with events.
    source.close();
    setTimeout(async () => {
      const answer = await fetch("/farm", { redirect: "manual" }).catch(() => null);
      if (answer?.type === "opaqueredirect") {
        location.reload();
      } else {
        clearTimeout(patience);
        lost.hidden = answer !== null && answer.ok;
        follow(sections);
      }
    }, 3000);
  });
}

for (const form of document.querySelectorAll("form.filter")) {
  shorten(form);
}
for (const image of document.querySelectorAll("img[data-pixels]")) {
  view(image);
}
const live = [...document.querySelectorAll("[data-live]")];
if (live.length > 0) {
  follow(live);
}
