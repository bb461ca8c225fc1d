(() => {
  "use strict";
  const player = document.querySelector(".player");
  if (!player) return;
  const part = (name) => player.querySelector(name);
  const [button, trial, time, speed] = ["button", ".trial", ".time", ".speed"].map(part);
  const LOST = -32768;
  let film, from = null; // `from` is the clock's time at the film's beginning while it plays [ms]

  const numbers = (text) => new Int16Array(Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer);
  const take = () => {
    const data = trial.selectedOptions[0].dataset;
    const [real, simulated, points, step, lines, width, height, grid] = JSON.parse(data.picture);
    film = { real: numbers(real), simulated: numbers(simulated), points, step, lines, width, height, grid };
    for (const name of ["rate", "frames", "markers"]) film[name] = Number(data[name]);
    film.seconds = (film.frames - 1) / film.rate;
    time.max = film.seconds;
    part(".said").textContent = data.said;
  };

  // place of a point between two frames [mm from the middle], null where it isn't known
  const placeAt = (positions, at, point) => {
    const { frames, points, step } = film, frame = Math.min(Math.floor(at), frames - 2), share = at - frame;
    let a = 2 * (frame * points + point), b = a + 2 * points;
    if (positions[a] === LOST) a = b;
    if (positions[b] === LOST) b = a;
    if (positions[a] === LOST) return null;
    return [0, 1].map((k) => step * ((1 - share) * positions[a + k] + share * positions[b + k]));
  };

  const draw = () => {
    const canvas = part("canvas");
    const most = (0.7 * innerHeight * film.width) / film.height; // so that all of it and the controls are seen at once
    const width = Math.min(canvas.parentNode.clientWidth, Math.max(most, 240)), scale = width / film.width;
    const height = film.height * scale;
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
    const dots = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * dots);
    canvas.height = Math.round(height * dots);
    const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement);
    const color = (name) => style.getPropertyValue(`--${name}`);
    pen.scale(dots, dots);
    pen.lineJoin = pen.lineCap = "round";
    const onCanvas = ([x, y]) => [width / 2 + x * scale, height / 2 - y * scale];
    const line = (points) => {
      pen.beginPath();
      let lifted = true;
      for (const point of points) {
        if (point) pen[lifted ? "moveTo" : "lineTo"](...onCanvas(point));
        lifted = !point;
      }
      pen.stroke();
    };
    pen.strokeStyle = color("grid");
    pen.lineWidth = 1;
    const [right, top] = [film.width / 2, film.height / 2];
    for (let x = -Math.floor(right / film.grid) * film.grid; x < right; x += film.grid) line([[x, -top], [x, top]]);
    for (let y = -Math.floor(top / film.grid) * film.grid; y < top; y += film.grid) line([[-right, y], [right, y]]);
    const at = Math.min(Number(time.value) * film.rate, film.frames - 1);
    for (const kind of ["real", "simulated"]) {
      const positions = film[kind];
      const places = Array.from({ length: film.points }, (_, point) => placeAt(positions, at, point));
      pen.strokeStyle = pen.fillStyle = color(kind);
      pen.lineWidth = 1;
      pen.globalAlpha = 0.45;
      for (const marker of new Set([0, film.markers - 1])) {
        const behind = Array.from({ length: Math.floor(at) + 1 }, (_, frame) => placeAt(positions, frame, marker));
        line([...behind, places[marker]]);
      }
      pen.lineWidth = Math.max(3, width / 160);
      for (const points of film.lines) line(points.map((point) => places[point]).filter(Boolean));
      pen.globalAlpha = 1;
      for (const place of places.slice(0, film.markers).filter(Boolean)) {
        pen.beginPath();
        pen.arc(...onCanvas(place), Math.max(2.5, width / 260), 0, 2 * Math.PI);
        pen.fill();
      }
    }
    part("output").textContent = `${Number(time.value).toFixed(2)} s of ${film.seconds.toFixed(2)} s`;
  };

  const pause = () => {
    from = null;
    button.textContent = "Play";
  };
  const tick = (now) => {
    if (from === null) return;
    const at = ((now - from) / 1000) * Number(speed.value);
    time.value = Math.min(at, film.seconds);
    draw();
    if (at >= film.seconds) pause();
    else requestAnimationFrame(tick);
  };
  const goOn = () => {
    if (from !== null) from = performance.now() - (1000 * Number(time.value)) / Number(speed.value);
  };
  button.addEventListener("click", () => {
    if (from !== null) return pause();
    if (Number(time.value) >= film.seconds - 0.01) time.value = 0;
    from = 0;
    goOn();
    button.textContent = "Pause";
    requestAnimationFrame(tick);
  });
  time.addEventListener("input", () => { goOn(); draw(); });
  speed.addEventListener("change", goOn);
  trial.addEventListener("change", () => { take(); time.value = 0; goOn(); draw(); });
  addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  player.hidden = false;
  take();
  draw();
})();
