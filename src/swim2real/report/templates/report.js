(() => {
  "use strict";
  const all = (name) => document.querySelectorAll(name);
  // on paper everything is open
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    all("details").forEach((one) => (one.open = true));
  });
  addEventListener("afterprint", () => document.documentElement.classList.remove("printing"));
})();
