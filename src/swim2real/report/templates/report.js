(() => {
  "use strict";
  const { figures, darkOfLight } = JSON.parse(document.getElementById("plots").textContent);
  const prefersDark = matchMedia("(prefers-color-scheme: dark)");
  const touch = matchMedia("(pointer: coarse)").matches;
  const config = {
    displaylogo: false,
    showSendToCloud: false, // nothing leaves the page
    plotlyServerURL: "",
    modeBarButtons: [["toImage", "resetScale2d"]],
    toImageButtonOptions: { format: "svg" },
  };

  // a deep copy in the colors of the theme; Plotly writes into what it is given
  const themed = (value, dark) => {
    if (typeof value === "string") return dark ? darkOfLight[value] ?? value : value;
    if (Array.isArray(value)) return value.map((inner) => themed(inner, dark));
    if (value === null || typeof value !== "object") return value;
    return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, themed(inner, dark)]));
  };

  const draw = (dark) => {
    for (const [id, figure] of Object.entries(figures)) {
      const place = document.getElementById("plot-" + id);
      if (!place) continue;
      try {
        const { data, layout } = themed(figure, dark);
        if (touch) layout.dragmode = false; // a finger scrolls the page
        const displayModeBar = !touch && place.classList.contains("large") ? "hover" : false;
        Plotly.react(place, data, layout, { ...config, displayModeBar });
      } catch (error) {
        place.textContent = "This figure could not be drawn: " + error;
        place.classList.add("plot-error");
      }
    }
  };

  const resize = () => document.querySelectorAll(".plot.js-plotly-plot").forEach((place) => Plotly.Plots.resize(place));
  draw(prefersDark.matches);
  const widths = new Map();
  const observer = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      if (contentRect.width > 0 && widths.get(target) !== contentRect.width) Plotly.Plots.resize(target);
      widths.set(target, contentRect.width);
    }
  });
  document.querySelectorAll(".plot.js-plotly-plot").forEach((place) => observer.observe(place));
  prefersDark.addEventListener("change", () => draw(prefersDark.matches));
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    document.querySelectorAll("details").forEach((one) => (one.open = true));
    draw(false);
    resize();
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    draw(prefersDark.matches);
    resize();
  });
})();
