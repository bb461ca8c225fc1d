(() => {
  "use strict";
  const close = () => document.querySelectorAll(".picture[open]").forEach((one) => (one.open = false));
  addEventListener("keydown", (event) => {
    if (event.key === "Escape") close();
  });
  addEventListener("afterprint", close); // printing opens everything
})();
