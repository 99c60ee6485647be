// A diagram as an element of the page: draws what the server gives it; see panels.js.
export default {
  template: `<div :style="{height: height + 'px'}"></div>`,
  props: { content: Object, height: { type: Number, default: 300 } },
  mounted() { this.panels = new window.Schwung.Panels(this.$el, this.content); },
  beforeUnmount() { this.panels && this.panels.remove(); },
  watch: { content(next) { this.panels && this.panels.set(next); } },
};
